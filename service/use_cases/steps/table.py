"""The computations that run in processes of their own, by name.

Each imports its module when it runs, because every step starts a process: only what the step needs is loaded.
"""

from collections.abc import Callable, Mapping

from service.ports import Json, StepContext


def _inspect_file(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_features import inspect_uploaded_file

    return inspect_uploaded_file(context, arguments)


def _fetch_file(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_fetch import fetch_file

    return fetch_file(context, arguments)


def _features(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.kernels import ensure_compiled
    from service.use_cases.steps.run_features import extract_features_of_scan

    ensure_compiled(context.progress)
    return extract_features_of_scan(context, arguments)


def _register_pair(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_pair import register_pair

    return register_pair(context, arguments)


def _adjust_network(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_network import adjust_network

    return adjust_network(context, arguments)


def _choose_pairs(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_network_growth import choose_pairs

    return choose_pairs(context, arguments)


def _report_registration(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_registration_report import report_registration

    return report_registration(context, arguments)


def _report_lines(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_lines_report import report_lines

    return report_lines(context, arguments)


def _detect_edges(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_detect_edges import detect_edges_of_photo

    return detect_edges_of_photo(context, arguments)


def _echo(context: StepContext, arguments: Json) -> Json:
    from service.use_cases.steps.run_echo import echo

    return echo(context, arguments)


STEPS: Mapping[str, Callable[[StepContext, Json], Json]] = {
    "inspect-file": _inspect_file,
    "fetch-file": _fetch_file,
    "features": _features,
    "register-pair": _register_pair,
    "choose-pairs": _choose_pairs,
    "adjust-network": _adjust_network,
    "report-registration": _report_registration,
    "report-lines": _report_lines,
    "detect-edges": _detect_edges,
    "echo": _echo,
}
