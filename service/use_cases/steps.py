"""The computations that run in processes of their own, by name."""

from collections.abc import Callable, Mapping

from service.ports import Json, StepContext
from service.use_cases.run_echo import echo
from service.use_cases.run_features import extract_features_of_scan, inspect_uploaded_file
from service.use_cases.run_lines_report import report_lines
from service.use_cases.run_pair import register_pair
from service.use_cases.run_registration_report import report_registration

STEPS: Mapping[str, Callable[[StepContext, Json], Json]] = {
    "inspect-file": inspect_uploaded_file,
    "features": extract_features_of_scan,
    "register-pair": register_pair,
    "report-registration": report_registration,
    "report-lines": report_lines,
    "echo": echo,
}
