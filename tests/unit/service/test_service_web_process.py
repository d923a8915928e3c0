"""The web process starts light."""

import subprocess
import sys

HEAVY = ("numpy", "open3d", "cv2", "numba", "pye57", "laspy", "scipy.stats", "matplotlib")


def test_the_web_process_loads_no_heavy_library() -> None:
    program = f"import sys, service.main; print([name for name in {HEAVY} if name in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
