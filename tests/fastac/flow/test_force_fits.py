from fastac.flow.force_fits import fits_validation


def test_presses_that_others_need_unseen_are_not_fitted(make_scene):
    forces = {
        "outputs": ["force_z"],
        "poisson": {"solver": "adjoint"},
        "force": {"fit": "slopes", "clamp": False},
    }
    assert fits_validation(make_scene(**forces))
    assert not fits_validation(make_scene(**forces, training={"labels": "force"}))
    with_interval = forces | {"force": forces["force"] | {"coverage": 0.9}}
    assert not fits_validation(make_scene(**with_interval))
