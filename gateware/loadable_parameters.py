"""What a calibration sets in a datapath: registers and tables, with the values of its own pipeline."""

import numpy as np

from fastac.gateware.stream.tables import TableFormat
from fastac.models.integer.pipeline import IntegerPipeline


class LoadableParameters:
    """Mixin that lists the parameters that hardware with loadable weights takes, for Datapath.

    The inheriting class has `pipeline`, `fold`, `loadable`, `mlp`, `validity` and, as far as its scene needs
    them, `solver`, `darkness`, `displacement`, `dots`, `slip_stream` and `interval_stream`. Without
    `loadable` there are none.
    """

    pipeline: IntegerPipeline
    fold: int
    loadable: bool

    @property
    def loadable_registers(self) -> dict[str, tuple[int, int]]:
        """{name: (bits, value for this pipeline)} of the registers that a calibration sets."""
        if not self.loadable:
            return {}
        registers = {}
        scene = self.pipeline.scene
        if self.fold == 1:
            image = self.mlp.parameter_image(self.pipeline.layers)
            registers["network"] = self.mlp.parameter_bits, image
        if scene.force_from_slopes:
            force, mask = self.pipeline.force, (1 << self.pipeline.force.width) - 1
            words = [(int(c) & mask) << (k * force.width) for k, c in enumerate(force.constant)]
            registers["constant"] = (len(words) * force.width, sum(words))
        registers["limits"] = (
            self.validity.limits_bits,
            self.validity.limits_image(self.pipeline.validity),
        )
        if scene.wants_interval:
            found = self.interval_stream
            registers["interval_base"] = len(found.base.as_value()), found.base_image
        return registers

    @property
    def loadable_tables(self) -> dict[str, tuple[TableFormat, np.ndarray]]:
        """{name: (format, values (depth, fields) for this pipeline)} of tables that a calibration sets."""
        if not self.loadable:
            return {}
        tables, scene = {}, self.pipeline.scene
        if self.fold > 1:
            tables["network"] = self.mlp.table, self.mlp.table_values
        if scene.wants_solver and scene.poisson.mode == "difference":
            tables["offset"] = self.solver.source.table, self.solver.source.table_values
        if scene.wants_darkness:
            tables["threshold"] = self.darkness.table, self.darkness.table_values
        if scene.force_from_displacement and self.displacement.loadable:
            tables["rest"] = self.displacement.table, self.displacement.table_values
        if scene.wants_dots:
            tables["dot_records"] = self.dots.table.format, self.dots.table.values
        if scene.wants_slip:
            tables |= {name: (t.format, t.values) for name, t in self.slip_stream.tables.items()}
        if scene.wants_interval:
            table = self.interval_stream.table
            tables["interval_weights"] = table.format, table.values
        return tables
