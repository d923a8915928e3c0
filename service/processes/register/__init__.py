"""Process `register`: how scans lie to each other."""

from collections.abc import Mapping

from schemas.requests.execution import FileOutputRequest
from schemas.requests.register_inputs import RegisterInputs
from schemas.requests.registered_output import RegisteredOutput
from schemas.results.registration_result import RegistrationDocument
from service.errors import InvalidRequestError
from service.ports import Process, Stored
from service.processes.register.plan import REGISTERED, RegisterPlan
from service.use_cases.inputs.check_control import system_faults
from service.use_cases.inputs.check_stations import check_register_inputs
from service.use_cases.inputs.validate_request import WRONG_FIELDS


def _check(inputs: RegisterInputs, stored: Stored) -> None:
    settings = stored.settings
    check_register_inputs(inputs, stored.files, settings.max_stations, settings.max_whole_stations)


def _check_files(inputs: RegisterInputs, wanted: Mapping[str, FileOutputRequest]) -> None:
    registered = wanted.get(REGISTERED)
    if isinstance(registered, RegisteredOutput) and (faults := list(system_faults(inputs, registered))):
        raise InvalidRequestError(WRONG_FIELDS, faults)


REGISTER = Process(
    id="register",
    title="Register scans",
    description="Finds how two or more terrestrial laser scans lie to each other from the straight lines, planes and "
    "cylinders in them and the edges in photos taken with them, without a first guess, and says how well each "
    "parameter is known or that it is not determined.",
    inputs=RegisterInputs,
    outputs=RegistrationDocument,
    plan=RegisterPlan(),
    steps={
        "compare-method": "service.use_cases.steps.run_method_comparison:compare_method",
        "station-targets": "service.use_cases.steps.station_targets:find_station_targets",
        "tie-stations": "service.use_cases.steps.run_tied_stations:tie_stations",
        "choose-pairs": "service.use_cases.steps.run_network_growth:choose_pairs",
        "report-registration": "service.use_cases.steps.run_registration_report:report_registration",
        "list-registered": "service.use_cases.steps.run_registration_report:list_registered",
    },
    check=_check,
    check_files=_check_files,
    needs_open3d=lambda _inputs, wanted: any(getattr(each, "smooths", False) for each in wanted.values()),
    file_outputs={REGISTERED: RegisteredOutput},
)
