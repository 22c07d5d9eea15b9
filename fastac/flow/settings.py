"""Which parts of a scene the float models depend on."""

from fastac.scenes.schema import Scene


def settings(scene: Scene, *names: str) -> dict:
    """The parts of a scene with these names, besides what any step depends on, as JSON."""
    content = scene.model_dump(mode="json")
    return {name: content[name] for name in ("outputs", "sensor", *names)}


def network_settings(scene: Scene) -> dict:
    """What of a scene its float pixel network depends on, as JSON."""
    return settings(scene, "network", "training", *(("numbers",) if scene.training.labels == "force" else ()))


def float_settings(scene: Scene) -> dict:
    """What of a scene the results of its float pipeline and force models depend on, as JSON."""
    parts = network_settings(scene) | settings(scene, "poisson", "force")
    return parts | {"slope_limit": scene.numbers.slope_limit}
