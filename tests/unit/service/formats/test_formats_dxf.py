"""Lines as a drawing."""

import io

import ezdxf
import numpy as np

from service.formats.dxf_lines_writer import LineLayer, dxf_lines


def test_lines_come_back_from_the_drawing_in_metres_with_their_layers_and_colours() -> None:
    far = np.array([500_000.125, 5_300_000.25, 412.5])
    starts, ends = (
        np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]) + far,
        np.array([[1.0, 0.0, 0.0], [1.0, 2.0, 5.0]]) + far,
    )
    layers = [LineLayer("S1 used", (0, 128, 96), starts, ends), LineLayer("Süd/2: *", (200, 40, 40), ends, starts)]
    drawing = ezdxf.read(io.StringIO(dxf_lines(layers).decode()))
    assert drawing.units == 6  # metres
    lines = list(drawing.modelspace())
    np.testing.assert_array_equal([tuple(line.dxf.start) for line in lines], np.vstack([starts, ends]))
    assert [line.dxf.layer for line in lines] == ["S1 used"] * 2 + ["Süd_2_ _"] * 2
    assert drawing.layers.get("S1 used").rgb == (0, 128, 96)


def test_no_lines_give_an_empty_drawing() -> None:
    assert len(list(ezdxf.read(io.StringIO(dxf_lines([]).decode())).modelspace())) == 0
