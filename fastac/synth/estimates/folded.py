"""What the stages of folded designs are counted for, below one pixel a clock, and their memories.

The other stages of such a design are those of one pixel a clock (`resources.py`).
"""

from collections.abc import Iterator

from fastac.gateware.cycle_model import CycleModel
from fastac.gateware.network.folded_layer import FoldedLayer
from fastac.gateware.network.folded_output import FoldedOutput
from fastac.gateware.poisson.folded_transform import FoldedDst1
from fastac.models.integer.force import PatchForce
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.sine_transform import SineTransform

STAGES = ("normals", "gradients", "transforms", "force")
"""The stages that are folded."""


def network_bits(pipeline: IntegerPipeline) -> dict[str, float]:
    """Bits of the network's weights that are read at once, and of the sums that products enter."""
    fold, words, sums = pipeline.scene.fold, 0, 0
    for k, layer in enumerate(pipeline.layers):
        neurons, inputs = layer.weight.shape
        kind = FoldedLayer if k < len(pipeline.layers) - 1 else FoldedOutput
        count = kind.multipliers_of(inputs, neurons, fold)
        words += count * layer.weight_bits
        sums += count * layer.accumulator_width
    return {"one": 1, "weight_bits": words, "sum_bits": sums}


def gradient_bits(pipeline: IntegerPipeline) -> dict[str, float]:
    """Bits of the dividers' adders, as many as there are units."""
    ratio, turn = pipeline.ratio, pipeline.scene.fold // 2
    return {"one": 1, "bits": -(-(ratio.width + 1) // turn) * ratio.normal_width}


def transform_bits(transforms: list[SineTransform], fold: int) -> dict[str, float]:
    """How many transforms there are, and bits of their sums, differences and chains of products."""
    products = [FoldedDst1.products_of(t.size, fold) for t in transforms]
    chains = zip(products, transforms, strict=True)
    return {
        "one": len(transforms),
        "word_bits": sum(t.input_width for t in transforms),
        "chain_bits": sum(count * (t.input_width + t.coefficient_width) for count, t in chains),
    }


def force_bits(pipeline: IntegerPipeline) -> dict[str, float]:
    """Bits of the products, of the sums of all axes, and of a patch's words."""
    force, count = pipeline.force, CycleModel(pipeline.scene, hidden=pipeline.hidden).multipliers["force"]
    if isinstance(force, PatchForce):
        axes, operands = len(force.kernel), force.displacement_bits + force.kernel_bits
        words = force.size**2 * force.displacement_bits
    else:
        axes, operands, words = len(force.weight), force.input_width + force.weight_width, 0
    return {"one": 1, "product_bits": count * operands, "sum_bits": axes * force.width, "patch_bits": words}


def features(pipeline: IntegerPipeline, transforms: list[SineTransform]) -> dict[str, dict[str, float]]:
    """By folded stage, the counts that its look-up tables are fitted to.

    transforms : of the pipeline's solver
    """
    found = {"normals": network_bits(pipeline)}
    if pipeline.scene.wants_slopes:
        found["gradients"] = gradient_bits(pipeline)
    if transforms:
        found["transforms"] = transform_bits(transforms, pipeline.scene.fold)
    if pipeline.force is not None:
        found["force"] = force_bits(pipeline)
    return found


def transform_memories(transforms: list[SineTransform], fold: int) -> Iterator[tuple[str, int, int, int]]:
    """(stage, number, bits of a word, words) of the sines: a table for every two multipliers, which read it
    at once."""
    for transform in transforms:
        products = FoldedDst1.products_of(transform.size, fold)
        yield "transforms", -(-products // 2), transform.coefficient_width, 2 * (transform.size + 1)
