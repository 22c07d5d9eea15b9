"""Random indenters of a protocol: what a scene may name, and what a station draws."""

from typing import get_args

import numpy as np

from fastac.scenes.schema import Protocol
from fastac.sensor.mechanics.indenter import Ball, Cylinder
from fastac.sensor.mechanics.random_indenter import KINDS, indenter_of
from fastac.sensor.protocol import Station


def test_a_scene_may_name_every_kind_but_the_ball():
    names = get_args(get_args(Protocol.model_fields["more_shapes"].annotation)[0])
    assert ["ball", *names] == list(KINDS)


def test_a_station_draws_the_same_object_for_each_load():
    light, heavy, other = (
        indenter_of(Station("train", 0, 0, load_n, np.nan, (), "cylinder", draw))
        for load_n, draw in ((0.5, (1, 3)), (1.5, (1, 3)), (1.5, (1, 4)))
    )
    assert isinstance(light, Cylinder)
    assert light == heavy != other
    assert indenter_of(Station("train", 0, 0, 0.5, 10.0)) == Ball(10.0)
