"""The example for Kubernetes fits together, and names settings, images, commands, paths and figures that there are."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from service.settings import Settings

ROOT = Path(__file__).resolve().parent.parent.parent
DOCKERFILE = (ROOT / "docker" / "Dockerfile").read_text()
OBJECTS: list[dict[str, Any]] = yaml.safe_load((ROOT / "docker" / "kubernetes.yaml").read_text())["items"]
DEPLOYMENTS = {each["metadata"]["name"]: each["spec"] for each in OBJECTS if each["kind"] == "Deployment"}
PODS = {name: spec["template"]["spec"] for name, spec in DEPLOYMENTS.items()}
CONTAINERS = [each for pod in PODS.values() for each in (*pod["initContainers"], *pod["containers"])]
STOPS_WITHIN_S = 10


def of_kind(kind: str) -> list[dict[str, Any]]:
    return [each for each in OBJECTS if each["kind"] == kind]


def test_settings_are_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    (settings,), (secret,) = of_kind("ConfigMap"), of_kind("Secret")
    given = settings["data"] | secret["stringData"]
    given |= {each["name"]: "2" for container in CONTAINERS for each in container.get("env", ())}
    known = {f"TIELINE_{name.upper()}" for name in Settings.model_fields}
    assert {name for name in given if not name.startswith("AWS_")} <= known
    for name, value in given.items():
        assert isinstance(value, str), f"{name} is not in quotes"
        monkeypatch.setenv(name, value)
    assert Settings().auth == "required"
    assert {f"tieline {name}" for name in ("serve", "worker")} == {
        " ".join(container["command"]) for pod in PODS.values() for container in pod["containers"]
    }


def test_selectors_find_the_pods_they_mean() -> None:
    labels = {name: spec["template"]["metadata"]["labels"] for name, spec in DEPLOYMENTS.items()}
    assert {name: spec["selector"]["matchLabels"] for name, spec in DEPLOYMENTS.items()} == labels
    disrupted = {each["metadata"]["name"]: each["spec"] for each in of_kind("PodDisruptionBudget")}
    assert {name: spec["selector"]["matchLabels"] for name, spec in disrupted.items()} == labels
    (service,), (scaled,) = of_kind("Service"), of_kind("ScaledObject")
    assert service["spec"]["selector"] == labels["tieline-api"]
    assert scaled["spec"]["scaleTargetRef"]["name"] in labels


def test_ports_and_probes_are_those_of_the_service() -> None:
    (settings,), (service,) = of_kind("ConfigMap"), of_kind("Service")
    (api,) = PODS["tieline-api"]["containers"]
    (port,) = api["ports"]
    assert str(port["containerPort"]) == settings["data"]["TIELINE_PORT"]
    assert {port["name"]} == {each["targetPort"] for each in service["spec"]["ports"]}
    routes = "".join(path.read_text() for path in (ROOT / "service" / "routes").glob("*.py"))
    for name in ("startupProbe", "livenessProbe", "readinessProbe"):
        assert api[name]["httpGet"]["port"] == port["name"]
        assert f'"{api[name]["httpGet"]["path"]}"' in routes
    (worker,) = PODS["tieline-worker"]["containers"]
    copied = re.findall(r"(?m)^COPY docker/\S+ (\S+[.]py)$", DOCKERFILE)
    assert worker["livenessProbe"]["exec"]["command"] == ["python", *copied]


@pytest.mark.parametrize("name", PODS)
def test_pods_may_do_no_more_than_they_must(name: str) -> None:
    pod, user = PODS[name], re.findall(r"(?m)^USER (\d+)$", DOCKERFILE)
    assert pod["securityContext"]["runAsNonRoot"] is True
    assert [str(pod["securityContext"]["runAsUser"])] == user
    assert pod["automountServiceAccountToken"] is False
    assert pod["terminationGracePeriodSeconds"] > STOPS_WITHIN_S
    for container in (*pod["initContainers"], *pod["containers"]):
        assert container["securityContext"]["readOnlyRootFilesystem"] is True
        assert container["securityContext"]["allowPrivilegeEscalation"] is False
        assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
        assert container["resources"]["limits"].keys() == {"cpu", "memory"}
        assert {mount["name"] for mount in container["volumeMounts"]} <= {volume["name"] for volume in pod["volumes"]}


def test_compiled_kernels_are_where_the_image_has_and_looks_for_them() -> None:
    folder = Path(re.findall(r"NUMBA_CACHE_DIR=(\S+)", DOCKERFILE)[0])
    for pod in PODS.values():
        (kernels,), (program,) = pod["initContainers"], pod["containers"]
        assert kernels["command"][-2] == str(folder)
        (there,) = (each["mountPath"] for each in kernels["volumeMounts"])
        assert kernels["command"][-1].rstrip("/") == there
        data = {
            each["mountPath"] for each in program["volumeMounts"] if each["name"] == kernels["volumeMounts"][0]["name"]
        }
        assert data == {str(folder.parent)}


def test_it_grows_by_figures_that_there_are() -> None:
    (scaled,) = of_kind("ScaledObject")
    figures = (ROOT / "service" / "routes" / "metrics.py").read_text()
    (trigger,) = scaled["spec"]["triggers"]
    named = re.findall(r"(tieline_\w+)\{(\w+)=\"(\w+)\"\}", trigger["metadata"]["query"])
    assert named
    for metric, label, _ in named:
        assert re.search(rf'"{metric}", [^\n]*labels=\["{label}"\]', figures)
    assert {value for metric, _, value in named if metric == "tieline_steps"} == {"waiting", "running"}
