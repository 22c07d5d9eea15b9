"""The components that are mutated, each with the tests that must find its mutants."""

from dataclasses import dataclass

TESTS = "tests/gateware"


@dataclass(frozen=True)
class Allowed:
    """Mutants that no test can or should find: on lines of the source that hold `code`, and why.

    changes : beginnings of what is changed, as the table of survivors says it; empty: anything
    """

    code: str
    why: str
    changes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Component:
    """A file of `gateware/` and its own tests.

    tests : files or cases below tests/gateware, in the order in which they run; what is `full` is left out,
        unless it is marked `mutate`
    designs : of how many of the designs that the tests bring up mutants are drawn, the first ones
    datapath : whether pixels or forces pass through it; then 95% of its mutants must be found
    allowed : explanations of mutants that survive
    """

    name: str
    tests: tuple[str, ...]
    designs: int = 1
    datapath: bool = True
    allowed: tuple[Allowed, ...] = ()

    @property
    def source(self) -> str:
        return f"gateware/{self.name}.py"

    @property
    def test_paths(self) -> tuple[str, ...]:
        return tuple(f"{TESTS}/{test}" for test in self.tests)


ANOTHER_ORDER = "goes through other states in as many steps, and they are not visible"
NO_FILLING = (
    "under back-pressure the pipeline does not close its gaps: nothing is lost, and no rate is stated"
)
READ_AGAIN = "reads in clocks whose word nobody uses; what is used is read again"
STEPS_FOR_NOBODY = "steps without a frame: registers move, and nobody looks at them"
WRITTEN_AGAIN = "writes the word that has been written again, to the same place"

COMPONENTS = (
    Component(
        "arithmetic/frame_sum",
        ("arithmetic/test_frame_sum.py::test_sums_under_verilator",),
        allowed=(Allowed("beat.eq(Mux(last, 0, beat + 1))", ANOTHER_ORDER),),
    ),
    Component(
        "arithmetic/adder_pipeline",
        ("test_mlp_mvm.py::test_baked_weights", "test_mlp_mvm.py::test_baked_signs"),
    ),
    Component("arithmetic/packed_products", ("arithmetic/test_packed_products.py",)),
    Component("arithmetic/product", ("arithmetic/test_product.py",), designs=2),
    Component(
        "arithmetic/shift_add",
        ("test_mlp_mvm.py::test_baked_weights", "test_mlp_mvm.py::test_loadable_weights"),
    ),
    Component("bus/axi_lite", ("bus/test_axi_lite.py",), datapath=False),
    Component("bus/calibration_loader", ("bus/test_calibration_loader.py",), datapath=False),
    Component(
        "bus/frame_timer",
        ("bus/test_frame_timer.py",),
        datapath=False,
        allowed=(
            Allowed(
                "write.en.eq(self.frame_done & ~self.flush)",
                "stamps of a frame that is discarded: written, and never read",
                ("A[0] = 0",),
            ),
            Allowed(
                "given.eq(given + 1)",
                "of the maps' counters only the address, their lowest bits, is used",
                ("A[4]",),
            ),
        ),
    ),
    Component("bus/registers", ("bus/test_registers.py",), datapath=False, designs=2),
    Component("bus/result_fifo", ("bus/test_result_fifo.py",), designs=2),
    Component("bus/result_registers", ("bus/test_registers.py",), designs=2),
    Component("dots/axis", ("dots/test_follower.py::test_stream_rules_in_verilator",)),
    Component("dots/dark_queue", ("dots/test_dark_queue.py",)),
    Component("dots/darkness", ("dots/test_darkness.py",)),
    Component(
        "dots/follower",
        ("dots/test_follower.py::test_stream_rules_in_verilator",),
        allowed=(
            Allowed("step.eq(step + 1)", ANOTHER_ORDER),
            Allowed("with m.If(step == steps - 1):", "the step does not go beyond the fourth", ("A[1] = 0",)),
        ),
    ),
    Component("dots/window_stream", ("dots/test_window_stream.py::test_stream_rules_in_verilator",)),
    Component(
        "dst1_engine",
        ("test_dst1_engine.py::test_bit_exact_to_golden_model",),
        allowed=(
            Allowed(
                "beat.eq(Mux(last_beat, 0, beat + 1))",
                "after four beats the counter of two bits is 0 by itself",
                ("S[0] = 0",),
            ),
            Allowed("beat.eq(Mux(last_beat, 0, beat + 1))", ANOTHER_ORDER),
            Allowed(
                "words = table.read_port()",
                "the bit is 1 in all of that lane's coefficients; the void lane's one is 0",
                ("DATA[229] = 1",),
            ),
        ),
    ),
    Component("force/bent_product", ("force/test_bent_product.py",), designs=2),
    Component("force/folded_patch", ("force/test_folded_patch.py::test_force_and_map_of_every_frame",)),
    Component("force/folded_sum", ("force/test_folded_sum.py::test_bends_in_verilator",)),
    Component("force/force_interval", ("force/test_force_interval.py",)),
    Component("force/force_sum", ("force/test_force_sum.py",)),
    Component(
        "force/patch_generator",
        ("force/test_patch_generator.py",),
        allowed=(
            Allowed("write.en.eq(advance & stepped)", WRITTEN_AGAIN, ("Y[0] = 1", "A[0] = 1", "B[0] = 1")),
            Allowed(
                "rows = Signal(self.kernel_size",
                "the window's middle row is always inside the frame",
                ("D[1] inverted where D[2] = 0",),
            ),
            Allowed(
                "with m.If(advance & step):",
                "what is held while no step is taken is overwritten before it is stored or shifted on",
                ("B[0] = 1",),
            ),
            Allowed(
                "blanked[r][c].eq(Mux(rows_inside[r] & columns_inside[c]",
                "a row and a column of the window that are always inside the frame",
                ("Y[0] = 1",),
            ),
        ),
    ),
    Component("force/shared_accumulator", ("force/test_shared_accumulator.py",)),
    Component(
        "force/shared_products",
        (
            "force/test_folded_sum.py::test_force_of_every_frame",
            "force/test_folded_sum.py::test_bends_in_verilator",
        ),
        designs=2,
    ),
    Component(
        "force/block_address",
        ("force/test_weight_rom.py::test_words_of_squares_are_read_again",),
        datapath=False,
        allowed=(
            Allowed("row.eq(row + 1)", ANOTHER_ORDER),
            Allowed("beat.eq(Mux(ends_row, 0, beat + 1))", ANOTHER_ORDER),
        ),
    ),
    Component("force/weight_rom", ("force/test_weight_rom.py",)),
    Component(
        "force/weighted_sum",
        (
            "force/test_weighted_sum.py::test_force_of_every_frame",
            "force/test_weighted_sum.py::test_bends_in_verilator",
        ),
        designs=2,
    ),
    Component("fz_stream", ("test_fz_stream.py::test_force_of_every_frame",)),
    Component("mlp_mvm", ("test_mlp_mvm.py",), designs=2),
    Component(
        "network/light_follower",
        ("network/test_background.py::test_light_is_levelled_bit_exact_to_the_model",),
    ),
    Component(
        "network/background",
        ("network/test_background.py::test_capture",),
        allowed=(
            Allowed(
                "capturing.eq(own & ~last)", "the next beat is the first of a frame, which looks at `capture`"
            ),
        ),
    ),
    Component(
        "network/feature_smoothing",
        ("network/test_feature_smoothing.py",),
        designs=2,
        allowed=(
            Allowed("entered.eq(Mux(entered == count - 1, 0, entered + 1))", ANOTHER_ORDER),
            Allowed("pending.eq(", STEPS_FOR_NOBODY, ("A[",)),
            Allowed(
                "read = memory.read_port()",
                "the other bit is 0 in all codes of that lane",
                ("DATA[11] inverted where DATA[22] = 1",),
            ),
        ),
    ),
    Component("network/folded_layer", ("network/test_folded_layer.py",), designs=4),
    Component("network/folded_output", ("network/test_folded_output.py",), designs=2),
    Component("network/folded_requantise", ("network/test_folded_requantise.py",), designs=2),
    Component("network/folded_network", ("network/test_folded_network.py",), designs=2, datapath=False),
    Component(
        "network/folded_ratio",
        ("network/test_folded_ratio.py",),
        designs=2,
    ),
    Component(
        "network/gradient_ratio",
        ("network/test_gradient_ratio.py",),
        allowed=(
            Allowed(
                "beyond = over | Cat(quotient).all()",
                "at these widths a quotient of ones has a numerator as large as its divisor, which is `over`",
                ("A[4] = 0",),
            ),
            Allowed(
                "divisor = register(Mux(n_z <= 0,",
                "what replaces a divisor that is not positive: 0 divided by it is 0, all else saturates",
                ("B[1] inverted",),
            ),
        ),
    ),
    Component(
        "network/requantise",
        ("network/test_requantise.py",),
        designs=2,
        allowed=(
            Allowed(
                "positive = register(Mux(a < 0, 0, ",
                "a small value in place of 0, whose product is below one step",
                ("B[7] inverted",),
            ),
            Allowed(
                "clipped = Term(Mux(",
                "the top bit of the product, which no accumulator reaches",
                ("A[5] = 0",),
            ),
        ),
    ),
    Component(
        "network/slope_bridge",
        ("network/test_slope_bridge.py",),
        allowed=(Allowed("entering.eq(Mux(", ANOTHER_ORDER),),
    ),
    Component(
        "poisson/depth",
        ("poisson/test_depth.py",),
        designs=3,
        allowed=(Allowed("beat.eq(Mux(beat == beats - 1, 0, beat + 1))", ANOTHER_ORDER),),
    ),
    Component("poisson/eigenvalue_division", ("poisson/test_eigenvalue_division.py",)),
    Component(
        "poisson/folded_transform", ("poisson/test_folded_transform.py::test_bit_exact_to_golden_model",)
    ),
    Component(
        "poisson/frame_reversal",
        ("poisson/test_recurrence.py::test_reversal",),
        allowed=(
            Allowed(
                "self.i.ready.eq(~whole | (written.address != taken.address))",
                "the writer waits one beat farther behind the reader; nothing is lost, and no rate is stated",
                ("B[0] = 0",),
            ),
            Allowed("advance.eq(self.o.ready | ~self.o.valid)", NO_FILLING),
            Allowed(
                "address.eq(address - (self.beats - 1))",
                "no frame begins at an address with this bit",
                ("Y[1] = 0",),
            ),
        ),
    ),
    Component(
        "poisson/recurrence",
        ("poisson/test_recurrence.py",),
        designs=2,
        allowed=(
            Allowed("write.en.eq(advance & self.o.valid)", WRITTEN_AGAIN, ("A[0] = 1",)),
            Allowed(
                "product = register(operand * coefficient",
                "bits below the half unit and the word that is added: nothing carries from them",
                tuple(f"Y[{bit}]" for bit in range(15)),
            ),
        ),
    ),
    Component("poisson/in_place_transposer", ("poisson/test_in_place_transposer.py",)),
    Component("poisson/source", ("poisson/test_source.py",), designs=3),
    Component("poisson/transposer", ("poisson/test_transposer.py",)),
    Component("poisson/tridiagonal", ("poisson/test_tridiagonal.py::test_bit_exact_to_golden_model",)),
    Component(
        "slip/contact",
        ("slip/test_contact.py::test_stream_rules_in_verilator",),
        allowed=(
            Allowed(
                "index.eq(index + 1)",
                "after the eighth and last dot none is counted",
                ("A[2] inverted where A[3]",),
            ),
        ),
    ),
    Component(
        "slip/product_sum",
        ("slip/test_spread_ratio.py::test_stream_rules_in_verilator",),
        allowed=(
            Allowed(
                "minus = Const(0, 1) if self.only_adds",
                "upper bits of C, which nobody reads before the sum begins afresh",
                ("A[0] = 0", "B[0] = 0"),
            ),
            Allowed(
                "term = (self.shifted",
                "a bit added in an even number of clocks, and so not at all",
                ("Y[7] inverted",),
            ),
            Allowed(
                "self.total.eq(self.total + term",
                "a bit inverted in an even number of clocks, and so not at all unless a carry passes it",
                ("A[23] inverted",),
            ),
        ),
    ),
    Component("slip/rigid_sums", ("slip/test_rigid_sums.py",)),
    Component(
        "slip/spread_ratio",
        ("slip/test_spread_ratio.py::test_stream_rules_in_verilator",),
        allowed=(Allowed("step.eq(step - 1)", ANOTHER_ORDER),),
    ),
    Component("packets/packet_input", ("packets/test_packet_input.py",)),
    Component("packets/packet_port", ("packets/test_packet_port.py",), designs=2),
    Component("packets/record_beats", ("packets/test_record_beats.py",), designs=2),
    Component("packets/record_queue", ("packets/test_record_queue.py",), designs=2),
    Component("stream/fork", ("stream/test_fork.py",), designs=2),
    Component("stream/frame_end", ("stream/test_frame_end.py",), designs=4),
    Component(
        "stream/frame_guard",
        ("stream/test_frame_guard.py",),
        allowed=(
            Allowed(
                "self.frame_bad.eq(bad | self.line_short",
                "is read at a frame's last beat, which ends no line too early",
                ("B[0] = 0",),
            ),
        ),
    ),
    Component(
        "stream/frame_validity",
        ("stream/test_frame_validity.py::test_every_measure_to_the_last_bit",),
        allowed=(
            Allowed(
                "queue.r_data | beyond",
                "the flag that is added here is not set in the queue",
                ("A[8] = 0", "A[0] inverted where A[8] = 1"),
            ),
            Allowed(
                "measure < low[name]",
                "the sign of a limit that is never negative",
                ("B[8] inverted where B[18]",),
            ),
        ),
    ),
    Component("stream/handshake", ("stream/test_handshake.py",), designs=2),
    Component(
        "stream/queues",
        ("stream/test_queues.py",),
        designs=2,
        allowed=(
            Allowed("under_way", "shows only with more credits than the queue has places", ("A[2]", "Y[2]")),
        ),
    ),
    Component(
        "stream/read_ahead_rom",
        ("stream/test_read_ahead_rom.py",),
        designs=2,
        allowed=(
            Allowed(
                "enable.eq(~full & (following[place:] == number))",
                "reads in clocks whose word nobody uses; enables save power",
                ("A[0] = 0", "Y[0] = 1"),
            ),
            Allowed(
                "full.eq(after == QUEUE_WORDS)",
                "shows only with more words than the queue has places",
                ("A[1] = 0",),
            ),
        ),
    ),
    Component("stream/raster_port", ("stream/test_raster_port.py",), designs=2),
    Component(
        "stream/tables",
        ("poisson/test_depth.py::test_loaded_rest", "poisson/test_source.py"),
        designs=2,
        allowed=(Allowed("read.en.eq(self.advance & self.take)", READ_AGAIN, ("B[0] = 1",)),),
    ),
)
