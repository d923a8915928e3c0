"""What GNU Gama made of its networks."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

SPACE = "{http://www.gnu.org/software/gama/gama-local}"
ANSWER = "{http://www.gnu.org/software/gama/gama-local-adjustment}"


def y_sign(network: ET.Element) -> float:
    """Give -1 where x and y of a file are left-handed: its y is turned round."""
    return 1.0 if network.get("axes-xy", "ne") in {"en", "nw", "se", "ws"} else -1.0


def gama_answer(path: Path) -> tuple[dict[str, np.ndarray], float, int, float]:
    """Read adjusted coordinates, [pvv], degrees of freedom and the a-priori standard deviation of a result."""
    root = ET.parse(path.with_suffix(".xml")).getroot()  # noqa: S314 - files of this project's data folder
    adjusted = root.find(f".//{ANSWER}coordinates/{ANSWER}adjusted")
    assert adjusted is not None
    network = ET.parse(path).getroot().find(f"{SPACE}network")  # noqa: S314 - likewise
    assert network is not None
    flip = y_sign(network)
    found = {}
    for point in adjusted:
        values = {e.tag.removeprefix(ANSWER).lower(): e.text for e in point}
        if {"x", "y", "z"} <= set(values):
            xyz = np.array([float(values[k] or "nan") for k in "xyz"])
            xyz[1] *= flip
            found[str(values["id"])] = xyz
    squares = float(root.findtext(f".//{ANSWER}sum-of-squares") or "nan")
    freedom = int(root.findtext(f".//{ANSWER}degrees-of-freedom") or 0)
    prior = float(root.findtext(f".//{ANSWER}apriori") or "nan")
    return found, squares, freedom, prior
