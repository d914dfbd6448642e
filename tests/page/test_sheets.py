"""What is beside a scale of colours stays inside of its panel."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from fingerfit.report.page.sheets import DPI, Frame, colour_scale


@pytest.mark.parametrize("limits", [(0.0, 12.0, 0.0, 12.0), (0.0, 60.0, 0.0, 12.0)])
@pytest.mark.parametrize(
    ("label", "high"),
    [
        ("residual brightness (of 1)", 0.007),
        ("evidence for stiffer (+)\nor softer (-) material", 7.5),
        ("in mm", 0.00031),
        ("N", 31000.0),
    ],
)
def test_labels_and_numbers_of_a_scale_are_whole(limits, label, high):
    figure, axes, scale = Frame.around(limits).panel()
    shown = axes.imshow(np.zeros((2, 2)), vmin=-high, vmax=high, extent=limits)
    colour_scale(figure, shown, scale, label, "both")
    figure.set_dpi(DPI)
    FigureCanvasAgg(figure).draw()
    told = scale.yaxis.label.get_window_extent()
    at = zip(scale.get_yticks(), scale.get_yticklabels(), strict=True)
    numbers = [one.get_window_extent() for place, one in at if abs(place) <= high]
    assert len(numbers) >= 3
    assert max(one.x1 for one in numbers) < told.x0
    assert told.x1 <= figure.bbox.x1
