"""Process `register`: how scans lie to each other."""

from schemas.register_inputs import RegisterInputs
from schemas.registered_output import RegisteredOutput
from schemas.registration_result import RegistrationDocument
from service.ports import Process, Stored
from service.processes.register.plan import REGISTERED, RegisterPlan
from service.use_cases.inputs.check_stations import check_register_inputs


def _check(inputs: RegisterInputs, stored: Stored) -> None:
    check_register_inputs(inputs, stored.files, stored.settings.max_stations)


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
    file_outputs={REGISTERED: RegisteredOutput},
)
