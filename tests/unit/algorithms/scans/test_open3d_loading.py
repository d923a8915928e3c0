"""open3d is loaded where next to nothing of the machine may be read."""

import subprocess
import sys

CONFINED = """
import mimetypes

def refuse(self, filename, strict=True):
    raise PermissionError(filename)

mimetypes.MimeTypes.read = refuse
from algorithms.scans.open3d_loading import import_open3d
assert import_open3d().__name__ == "open3d"
assert mimetypes.knownfiles
"""


def test_the_media_types_of_the_system_are_not_asked_for() -> None:
    done = subprocess.run([sys.executable, "-c", CONFINED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
