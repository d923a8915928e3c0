"""Shadows that one photo shows and the other does not: other sun, or dark fields drawn over a photo."""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.lines import LineSource
from algorithms.photos.station_photo import StationPhoto
from algorithms.simulation.rendering_truth import EdgeKind, visible_edges
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.sun import MORNING, Daylight
from algorithms.simulation.virtual_camera import VirtualCamera, scanner_camera
from tests.scenes.photos.photographed_stations import HALF, Pair, Station, features_of, record, registered

AFTERNOON = Daylight(azimuth_rad=float(np.deg2rad(-125.0)), elevation_rad=float(np.deg2rad(28.0)))
OVERCAST = Daylight(elevation_rad=-0.1)
FIELDS_M = (
    ((2.8, 0.7), (4.0, 0.9), (3.9, 2.6), (2.9, 2.4)),
    ((5.55, 0.8), (6.4, 0.8), (6.4, 2.2), (5.55, 2.2)),
    ((4.8, 3.5), (6.2, 3.6), (5.5, 4.9)),
)
"""Corners (x, z) of fields on the front wall, away from everything that is there."""
DARKENED = 0.6
"""Share of the light that is left in them."""
FINER = 8
"""Fields are filled in so many times finer pixels: their edges then have no steps."""
ON_EDGE_M, BESIDE_M = 0.004, 0.01
"""A line is that of a shadow when both its ends lie this near to the shadow's edge, and farther from all others."""


@dataclass(frozen=True, eq=False)
class Planted:
    """A pair with shadows, and which lines are of shadows."""

    pair: Pair
    target_shadows: np.ndarray
    """Numbers of the target's lines that are edges of its shadows."""
    source_shadows: np.ndarray

    @property
    def used(self) -> list[tuple[int, int]]:
        """Pairs of lines that take part in the pose although one of them is the edge of a shadow."""
        fine = self.pair.result.fine
        assert fine is not None
        used = fine.lines[fine.adjustment.lines.states != CorrespondenceState.REMOVED]
        wrong = np.isin(used[:, 0], self.target_shadows) | np.isin(used[:, 1], self.source_shadows)
        return [(int(i), int(j)) for i, j in used[wrong]]


@cache
def other_sun(seed: int, name: str) -> Planted:
    """Photograph the front of the house in the morning and in another light."""
    scene, camera = SCENES["house_front"](), VirtualCamera(camera=scanner_camera(HALF))
    lights = (MORNING, {"afternoon": AFTERNOON, "overcast": OVERCAST}[name])
    stations, features, shadows = [], [], []
    for k, light in enumerate(lights):
        station = record(scene, k, np.random.default_rng([seed, k]), camera=camera, daylight=light)
        pose = station.world_from_scan * station.photos[0].scan_from_camera
        truth = visible_edges(scene, pose, camera, light)
        stations.append(station)
        features.append(features_of(station))
        is_shadow = truth.kinds == EdgeKind.SHADOW
        shadows.append(_lines_on(features[-1], station, truth.world[is_shadow], truth.world[~is_shadow]))
    pair = registered((stations[0], stations[1]), features[0], features[1])
    return Planted(pair, shadows[0], shadows[1])


@cache
def drawn_fields(seed: int) -> Planted:
    """Photograph the front of the house, and darken fields of the wall in the second photo."""
    scene, camera = SCENES["house_front"](), VirtualCamera(camera=scanner_camera(HALF))
    stations = [record(scene, k, np.random.default_rng([seed, k]), camera=camera) for k in (0, 1)]
    stations[1] = replace(stations[1], photos=(_darkened(stations[1]),))
    features = [features_of(station) for station in stations]
    corners = [np.array([(x, 0.0, z) for x, z in field]) for field in FIELDS_M]
    edges = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in corners])
    planted = _lines_on(features[1], stations[1], edges, np.empty((0, 2, 3)))
    pair = registered((stations[0], stations[1]), features[0], features[1])
    return Planted(pair, np.empty(0, dtype=np.int64), planted)


def _darkened(station: Station) -> StationPhoto:
    """Darken the fields in the photo of a station; distortion bends their edges as it should."""
    photo = station.photos[0]
    image = photo.image.astype(np.float64)
    camera_from_world = (station.world_from_scan * photo.scan_from_camera).inv()
    shares = np.linspace(0.0, 1.0, 50, endpoint=False)[:, None]
    for field in FIELDS_M:
        ring = np.array([(x, 0.0, z) for x, z in field])
        rim = np.concatenate([a + shares * (b - a) for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)])
        pixels = photo.camera.image_from_ideal(photo.camera.ideal_from_camera(camera_from_world.apply(rim)))
        first = np.floor(pixels.min(axis=0)).astype(np.int64) - 4
        width, height = np.ceil(pixels.max(axis=0)).astype(np.int64) + 5 - first
        # the centre of fine pixel k lies at (k + 0.5) / FINER - 0.5
        fine = np.rint((pixels - first + 0.5) * FINER - 0.5).astype(np.int32)
        mask = cv2.fillPoly(np.zeros((height * FINER, width * FINER), dtype=np.uint8), [fine], 255)
        share = mask.reshape(height, FINER, width, FINER).mean(axis=(1, 3)) / 255.0
        share = cv2.GaussianBlur(share, (0, 0), 0.6)
        rows, columns = slice(first[1], first[1] + height), slice(first[0], first[0] + width)
        image[rows, columns] *= (1.0 - (1.0 - DARKENED) * share)[:, :, None]
    return replace(photo, image=np.rint(image).astype(np.uint8))


def _lines_on(features: ScanFeatures, station: Station, shadows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Give the numbers of the lines of photos that run along edges of shadows (n, 2, 3), and along no other edge."""
    starts, ends = (station.world_from_scan.apply(places) for places in features.lines.end_points)
    on_shadow = _near(starts, ends, shadows, ON_EDGE_M)
    on_other = _near(starts, ends, others, BESIDE_M)
    in_photo = features.lines.sources == int(LineSource.PHOTO_EDGE)
    return np.flatnonzero(in_photo & on_shadow & ~on_other)


def _near(starts: np.ndarray, ends: np.ndarray, edges: np.ndarray, limit_m: float) -> np.ndarray:
    """Say which pieces have both ends within a limit of one of the edges, endless."""
    near = np.zeros(len(starts), dtype=bool)
    for first, last in edges:
        direction = (last - first) / np.linalg.norm(last - first)
        apart = [np.linalg.norm(np.cross(places - first, direction), axis=1) for places in (starts, ends)]
        near |= np.maximum(*apart) < limit_m
    return near
