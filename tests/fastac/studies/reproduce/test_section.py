from fastac.studies.reproduce.section import beside


def test_our_figure_beside_the_papers():
    assert beside(1.23456, 2) == ["1.2346", "2.0000"]
    assert beside(1.23456, None, 1) == ["1.2", ""]
