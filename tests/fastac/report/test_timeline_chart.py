"""Bars and labels of the timeline: the smallest stage keeps both."""

import matplotlib.pyplot as plt
import pytest

from fastac.report import timeline
from fastac.report.render import render
from fastac.report.timeline_chart import chart, draw
from fastac.scenes.pace import Pace

STAGES = {
    "normals": 59,
    "gradients": 19,
    "source": 16_389,
    "to_columns": 15_878,
    "solution_buffer": 1,
    "force": 142,
}
FOUND = timeline.of_image(STAGES, 128, 128, Pace())


def test_bars_are_in_percent_of_the_whole():
    shown = chart(FOUND)
    by_name = {row.stage.name: row for row in shown.rows}
    end = sum(STAGES.values())
    assert by_name["force"].left_percent == 100
    assert by_name["normals"].left_percent == pytest.approx(100 * 59 / end, abs=0.01)
    assert by_name["normals"].width_percent == pytest.approx(100 * 16_383 / end, abs=0.01)
    assert by_name["source"].adds_percent == 100
    assert 0 < by_name["solution_buffer"].adds_percent < by_name["gradients"].adds_percent < 40
    assert chart(FOUND, 2 * end).rows[-1].left_percent == 50
    assert [tick.label for tick in shown.ticks] == ["0", "8,000", "16,000", "24,000", "32,000"]


def test_labels_stand_where_there_is_room():
    by_name = {row.stage.name: row for row in chart(FOUND).rows}
    assert (by_name["force"].when, by_name["force"].text_at) == ("32,488", "right: calc(0.00% + 6px)")
    assert (by_name["normals"].when, by_name["normals"].text_class) == ("59 – 16,442", "inside")
    early = timeline.of_image({"normals": 282}, 16, 16, Pace())
    assert chart(early, 10_000).rows[1].text_at == "left: calc(2.82% + 8px)"


@pytest.mark.parametrize("name", ["solution_buffer", "gradients"])
def test_the_smallest_stages_have_name_and_number_in_the_picture(name):
    _, axis = plt.subplots()
    draw(axis, FOUND)
    assert f"{name.replace('_', ' ')}: +{STAGES[name]}" in [
        text.get_text() for text in axis.get_yticklabels()
    ]
    widths = [bar.get_width() for bar in axis.patches]
    assert len(widths) == len(FOUND)
    assert min(widths) > 0.003 * sum(STAGES.values())
    plt.close()


def test_the_colours_are_those_of_the_page():
    from fastac.report.timeline_chart import COLOURS

    style = render("report/style.css.j2")
    assert all(f"--{module}: {colour};" in style for module, colour in COLOURS.items())
