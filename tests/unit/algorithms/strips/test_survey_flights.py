"""The second simulator of strips: what it records is the land, moved by its errors and nothing else."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import survey_flights
from tests.scenes.survey_flights import GON, Country, Survey, SurveyErrors, surveyed, without_errors

SURVEY = Survey(length_m=200.0, lines=1, crossing=1, rows_per_s=20.0, points_per_row=60)


@pytest.fixture(scope="module")
def country() -> Country:
    return Country.drawn(SURVEY, 3)


def test_without_errors_the_land_is_recorded(country: Country) -> None:
    for strip in surveyed(SURVEY, country, without_errors(SurveyErrors()), 3):
        np.testing.assert_allclose(strip.silent_m, strip.true_m, atol=1e-6)
        np.testing.assert_allclose(country.at(strip.true_m[:, :2]), strip.true_m[:, 2], atol=1e-3)
        noise = np.linalg.norm(strip.points_m - strip.silent_m, axis=1)
        assert 0.5 * SURVEY.range_std_m < np.sqrt((noise**2).mean()) < 2.0 * SURVEY.range_std_m


def test_a_boresight_in_roll_moves_points_across_by_height_times_angle(country: Country) -> None:
    errors = replace(without_errors(SurveyErrors()), boresight_gon=(0.1, 0.0, 0.0))
    (strip, _) = surveyed(SURVEY, country, errors, 3)
    moved = np.linalg.norm(strip.silent_m - strip.true_m, axis=1)
    ranges = np.linalg.norm(
        strip.true_m
        - np.column_stack([np.interp(strip.times_s, strip.path_times_s, strip.path_m[:, k]) for k in range(3)]),
        axis=1,
    )
    np.testing.assert_allclose(moved, 0.1 * GON * ranges, rtol=1e-2)


def test_waves_are_those_of_the_reported_path(country: Country) -> None:
    errors = replace(without_errors(SurveyErrors()), wave_m=0.03)
    (strip, _) = surveyed(SURVEY, country, errors, 3)
    wave = strip.true_m[:, 2] - strip.silent_m[:, 2]
    assert 0.005 < wave.std() < 0.05


def test_the_simulator_knows_neither_the_estimator_nor_the_first_one() -> None:
    tree = ast.parse(Path(str(survey_flights.__file__)).read_text())
    modules = {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not any("strip" in module for module in modules)
