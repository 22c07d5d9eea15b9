import shutil

import pytest
from toy_steps import slopes, solved, states, weights

from fastac.store.steps import Step, StepError


def test_a_rule_stales_those_that_read_it(toy):
    for step in (slopes(toy), weights(toy)):
        toy.store().perform(step)
    toy.edit("schema.py", "self.fraction_bits + self.limit_bits", "self.fraction_bits + self.limit_bits + 1")
    assert toy.store().why(slopes(toy)) == "scene numbers.slope_bits = 17 was 16"
    assert toy.store().is_current(weights(toy))


def test_a_rule_with_the_same_value_stales_nothing(toy):
    toy.store().perform(slopes(toy))
    toy.edit(
        "schema.py", "self.fraction_bits + self.limit_bits", "sum((self.limit_bits, self.fraction_bits))"
    )
    assert toy.store().is_current(slopes(toy))


def test_a_new_or_unread_key_stales_nothing(toy):
    toy.store().perform(slopes(toy))
    assert toy.store().is_current(slopes(toy, numbers={"weight_bits": 5}))
    toy.edit("schema.py", "    solver: str", "    new_key: int = 3\n    solver: str")
    assert toy.store().is_current(slopes(toy))


def test_code_three_imports_away(toy):
    toy.store().perform(slopes(toy))
    toy.edit("words.py", "return value * FACTOR + bits", "return value * FACTOR - bits")
    assert toy.store().why(slopes(toy)) == f"code {toy.name}.words.round_to changed"
    toy.store().perform(slopes(toy))
    toy.edit("words.py", "FACTOR = 3", "FACTOR = 5")
    assert toy.store().why(slopes(toy)) == f"code {toy.name}.words.FACTOR changed"


def test_comments_docstrings_and_neighbours_stale_nothing(toy):
    toy.store().perform(slopes(toy))
    toy.edit("words.py", "'''Rounds.'''", "'''Rounds otherwise.'''  # a comment\n")
    toy.edit("words.py", "return 1", "return 2")
    toy.edit("words.py", "UNUSED = 4", "UNUSED = 5")
    assert toy.store().is_current(slopes(toy))


def test_a_library(toy, monkeypatch):
    import importlib.metadata

    toy.edit("words.py", "FACTOR = 3", "import numpy as np\n\nFACTOR = np.int64(3)")
    toy.store().perform(slopes(toy))
    installed = importlib.metadata.version
    version = installed("numpy")
    monkeypatch.setattr(
        importlib.metadata, "version", lambda name: "9.9" if name == "numpy" else installed(name)
    )
    assert toy.store().why(slopes(toy)) == f"library numpy 9.9 was {version}"


def test_a_toy_solver_stales_nobody_else(toy):
    names = Step("listed", toy.function("listed"))
    toy.store().perform(solved(toy))
    toy.store().perform(names)
    toy.edit("solvers.py", '"exact": Exact}', '"exact": Exact, "toy": Toy}')
    toy.edit("solvers.py", "SOLVERS =", "class Toy:\n    pass\n\n\nSOLVERS =")
    assert toy.store().is_current(solved(toy))
    listed = Step("listed", toy.function("listed"))
    assert toy.store().why(listed) == 'kinds of solver = ["fast", "exact", "toy"] was ["fast", "exact"]'


def test_the_chosen_solver_stales(toy):
    toy.store().perform(solved(toy))
    toy.store().perform(solved(toy, solver="exact"))
    toy.edit("solvers.py", "return 2", "return 3")
    assert toy.store().is_current(solved(toy))
    assert toy.store().why(solved(toy, solver="exact")) == f"code {toy.name}.solvers.Exact changed"
    assert toy.store().value(solved(toy, solver="exact")) == 3


def test_a_file_beside_the_module(toy):
    step = Step("page", toy.function("page"))
    assert toy.store().value(step) == "page"
    toy.write("page.html.j2", "other")
    step = Step("page", toy.function("page"))
    assert toy.store().why(step) == f"file {toy.name}/page.html.j2 changed"
    assert toy.store().value(step) == "other"


def test_a_bench_named_by_a_string(toy):
    toy.store().perform(Step("bench", toy.function("bench")))
    toy.edit("benches/top.py", "LEVEL = 1", "LEVEL = 2")
    why = toy.store().why(Step("bench", toy.function("bench")))
    assert why == f"code {toy.name}.benches.top (all of it) changed"


def test_unchanged_bytes_upstream_cut_off_staleness(toy):
    def chain(number):
        parity = Step("parity", toy.function("parity"), {"number": number}, ("parity.txt",))
        source = parity.output("parity.txt")
        return Step("doubled", toy.function("doubled"), {"source": source}, ("doubled.txt",))

    assert states(toy, chain(1)) == [("parity", "running"), ("doubled", "running")]
    assert toy.store().why(chain(3)) == "needs parity: number = 3 was 1"
    assert states(toy, chain(3)) == [("parity", "running"), ("doubled", "kept")]
    assert states(toy, chain(4)) == [("parity", "running"), ("doubled", "running")]


def test_a_path_counts_with_its_content(toy, tmp_path):
    source = tmp_path / "source.txt"

    def step():
        return Step("doubled", toy.function("doubled"), {"source": source}, ("doubled.txt",))

    source.write_text("a")
    toy.store().perform(step())
    shutil.copy(source, tmp_path / "copy.txt")
    source.write_text("b")
    assert toy.store().why(step()) == "source has other content"
    (tmp_path / "copy.txt").replace(source)
    assert toy.store().is_current(step())


def test_switching_back_reuses(toy):
    for fraction in (14, 10):
        toy.store().perform(slopes(toy, numbers={"fraction_bits": fraction}))
    for fraction in (14, 10):
        assert states(toy, slopes(toy, numbers={"fraction_bits": fraction})) == [("slopes", "kept")]


NESTED = """
    from fastac.store.steps import Step

    def outer(folder, scene, store, inner):
        return store.value(Step("inner", inner, {"scene": scene}))
    """


def test_a_step_inside_a_step(toy):
    toy.write("nested.py", NESTED)

    def step(**changes):
        unkeyed = {"store": toy.store(), "inner": toy.function("solved")}
        return Step("outer", toy.module("nested").outer, {"scene": toy.scene(**changes)}, (), unkeyed)

    assert states(toy, step()) == [("outer", "running")]
    assert states(toy, step(name="other")) == [("outer", "kept")]
    assert toy.store().why(step(solver="exact")) == 'scene solver = "exact" was "fast"'
    # The inner step is kept, and its reads still count for an outer one that runs.
    toy.edit("nested.py", "return store", "return 0 + store")
    assert states(toy, step()) == [("outer", "running")]
    assert not toy.store().is_current(step(solver="exact"))
    toy.edit("solvers.py", "return 2", "return 3")
    assert toy.store().is_current(step())
    toy.edit("solvers.py", "return 1", "return 5")
    assert toy.store().why(step()) == f"code {toy.name}.solvers.Fast changed"
    toy.store().perform(step())
    toy.edit("steps.py", "SOLVERS[scene.solver]().solve()", "SOLVERS[scene.solver]().solve() + 1")
    assert not toy.store().is_current(step())


def test_an_outer_step_needs_the_inner_result(toy):
    toy.write("nested.py", NESTED)
    unkeyed = {"store": toy.store(), "inner": toy.function("solved")}
    step = Step("outer", toy.module("nested").outer, {"scene": toy.scene()}, (), unkeyed)
    toy.store().perform(step)
    shutil.rmtree(toy.kept / "solved", ignore_errors=True)
    shutil.rmtree(toy.kept / "inner")
    assert toy.store().why(step) == "the result of inner step inner is no longer there"


def test_code_edited_while_the_process_runs(toy):
    store, step = toy.store(), solved(toy)
    store.perform(step)
    path = toy.folder / "solvers.py"
    path.write_text(path.read_text().replace("return 1", "return 9"))
    with pytest.raises(RuntimeError, match="start it again"):
        store.perform(step)


def test_values_are_normalised(toy):
    import numpy as np

    step = Step(
        "slopes", toy.function("slopes"), {"scene": toy.scene(), "value": np.int64(2)}, ("slopes.txt",)
    )
    toy.store().perform(step)
    same = Step("slopes", toy.function("slopes"), {"scene": toy.scene(), "value": 2}, ("slopes.txt",))
    assert toy.store().is_current(same)
    other = Step("slopes", toy.function("slopes"), {"scene": toy.scene(), "value": 2.0}, ("slopes.txt",))
    assert toy.store().why(other) == "value = 2.0 was 2"
    bad = Step("slopes", toy.function("slopes"), {"scene": toy.scene(), "value": object()}, ("slopes.txt",))
    with pytest.raises(StepError, match="argument value"):
        toy.store().perform(bad)
