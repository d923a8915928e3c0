"""open3d is loaded where next to nothing of the machine may be read."""

import subprocess
import sys

CONFINED = """
import mimetypes
import sys

def refuse(self, filename, strict=True):
    raise PermissionError(filename)

mimetypes.MimeTypes.read = refuse
from algorithms.scans.open3d_loading import import_open3d
assert import_open3d().__name__ == "open3d"
assert not {"dash", "plotly", "flask"} & sys.modules.keys()
"""


def test_the_viewer_for_notebooks_is_left_out_which_asks_for_the_media_types_of_the_system() -> None:
    done = subprocess.run([sys.executable, "-c", CONFINED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
