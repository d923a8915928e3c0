"""Steps that the plans of all processes may call, and those of files that arrive: ``module:function`` by name."""

from collections.abc import Mapping

SHARED_STEPS: Mapping[str, str] = {
    "inspect-file": "service.use_cases.steps.run_features:inspect_uploaded_file",
    "check-request": "service.engine.checked_request:check_request",
    "fetch-file": "service.use_cases.steps.run_fetch:fetch_file",
    "read-poses": "service.use_cases.steps.job_poses:read_poses",
    "features": "service.use_cases.steps.run_features:extract_features_with_kernels",
    "viewer-points": "service.use_cases.steps.run_viewer_points:write_points_of_scan",
    "register-pair": "service.use_cases.steps.run_pair:register_pair",
    "adjust-network": "service.use_cases.steps.run_network:adjust_network",
    "write-registered": "service.use_cases.steps.registered_files:write_registered",
}
