import pytest

from fastac.store.closure import CodeError
from fastac.store.modules import SourceError


@pytest.fixture
def reached(toy):
    """The symbols of a function's closure, without the project's name."""

    def find(text: str, name: str = "f") -> set[str]:
        toy.write("under_test.py", text)
        symbols = toy.code().closure(f"{toy.name}.under_test:{name}").symbols
        return {symbol.replace(f"{toy.name}.", "") for symbol in symbols} - {"under_test.f"}

    return find


WORDS = {"words.round_to", "words.FACTOR"}


@pytest.mark.parametrize(
    "text",
    [
        "from ROOT.words import round_to\ndef f(folder): round_to(1, 2)",
        "from ROOT import words\ndef f(folder): words.round_to(1, 2)",
        "import ROOT.words as w\ndef f(folder): w.round_to(1, 2)",
        "import ROOT.words\ndef f(folder): ROOT.words.round_to(1, 2)",
        "from . import words\ndef f(folder): words.round_to(1, 2)",
        "from .words import round_to as r\ndef f(folder, x=r): pass",
        "def f(folder):\n    from .words import round_to\n    return [round_to(1, i) for i in range(3)]",
        "def f(folder):\n    import ROOT.words as w\n    def g(): return w.round_to\n    return g",
        "from .words import round_to\n@round_to\ndef f(folder): pass",
        "from .words import round_to\ndef f(folder: round_to): pass",
        "from .words import round_to\ndef f(folder: 'list[round_to]'): pass",
        "from .words import round_to\nf = lambda folder: round_to(1, 2)",
    ],
)
def test_ways_to_refer(reached, text):
    assert reached(text) == WORDS


def test_bases_methods_and_constants(reached):
    text = """
        from .words import round_to
        class A:
            def m(self): return round_to
        class B(A):
            pass
        X = B
        y = 3
        def f(folder): return X()
        """
    assert reached(text) == WORDS | {"under_test.A", "under_test.B", "under_test.X"}


def test_local_names_are_no_references(reached):
    text = """
        from . import words, middle
        def f(folder, words):
            middle = words
            return [folder for words in middle]
        """
    assert not reached(text)


def test_a_comprehension_binds_only_inside(reached):
    text = "from .words import round_to\ndef f(folder):\n    return [0 for round_to in folder], round_to"
    assert reached(text) == WORDS


def test_re_exports(toy, reached):
    toy.write("room/__init__.py", "from ..words import round_to as rounded\n")
    assert reached("from ROOT.room import rounded\ndef f(folder): rounded(1, 2)") == WORDS
    assert reached("from ROOT import room\ndef f(folder): room.rounded(1, 2)") == WORDS


def test_a_module_passed_on_counts_as_a_whole(reached):
    text = "from ROOT import words\ndef f(folder): return getattr(words, folder)"
    assert "words (all of it)" in reached(text)


def test_a_star_import_counts_as_a_whole(reached):
    assert "words (all of it)" in reached("from .words import *\ndef f(folder): return round_to(1, 2)")


def test_statements_with_side_effects_count(toy, reached):
    toy.write("effects.py", "from .words import round_to\nTABLE = {}\nTABLE['a'] = round_to\n")
    toy.write("between.py", "from . import effects\ndef g(): pass\n")
    found = reached("from .between import g\ndef f(folder): g()")
    assert found == WORDS | {"between.g", "effects (statements)", "effects.TABLE"}


def test_a_module_run_as_a_script_does_not_count(reached):
    text = "from .words import round_to\ndef f(folder): pass\nif __name__ == '__main__':\n    round_to(1, 2)"
    assert not reached(text)


def test_names_bound_in_a_try(reached):
    text = (
        "try:\n    from .words import round_to\nexcept ImportError:\n    round_to = None\ndef f(x): round_to"
    )
    assert reached(text) == WORDS | {"under_test (statements)", "under_test.round_to"}


@pytest.mark.parametrize("text", ["'ROOT.benches.top'", "'ROOT.benches.top:run'", "f'ROOT.benches.{folder}'"])
def test_strings_that_name_modules(reached, text):
    assert "benches.top (all of it)" in reached(f"def f(folder): return {text}")


@pytest.mark.parametrize(
    ("text", "file"),
    [
        ("'page.html.j2'", "page.html.j2"),
        ("folder / 'data' / 'lint.vlt'", "data/lint.vlt"),
        ("folder.joinpath('data', 'lint.vlt')", "data/lint.vlt"),
        ("'data'", "data"),
    ],
)
def test_strings_that_name_files(toy, reached, text, file):
    toy.write("data/lint.vlt", "waived")
    assert f"file {toy.name}/{file}" in reached(f"def f(folder): return {text}")
    assert not reached("def f(folder): return 'no.vlt', '/etc/passwd', '../page.html.j2', '.'")
    toy.write("__pycache__/loops/kept.nbc", "written while a step runs")
    assert not reached("def f(folder): return folder / '__pycache__' / 'loops', '__pycache__'")


def test_files_that_include_files(toy, reached):
    toy.write("page.html.j2", "{% include 'base.html.j2' %}")
    toy.write("base.html.j2", "")
    assert len(reached("def f(folder): return 'page.html.j2'")) == 2


def test_settings_are_opaque_only_as_annotations(reached):
    head = "from .schema import Scene\n"
    assert not reached(head + "def f(folder, scene: Scene | None): return isinstance(folder, Scene)")
    assert "schema.Numbers" in reached(head + "def f(folder): return Scene()")


def test_tables_looked_up_while_running_are_opaque(reached):
    head = "from .solvers import SOLVERS\n"
    assert not reached(head + "def f(folder): return SOLVERS['fast']")
    whole = {"solvers.SOLVERS", "solvers.Fast", "solvers.Exact"}
    assert whole <= reached(head + "CHOSEN = SOLVERS['fast']\ndef f(folder): return CHOSEN")
    cached = "from functools import cache\ndef g(n): return SOLVERS[n]\n@cache\ndef h(n): return g(n)\n"
    assert whole <= reached(head + cached + "def f(folder): return h('fast')")


def test_all_kinds_that_a_function_can_choose(toy):
    toy.write("under_test.py", "from .solvers import SOLVERS\ndef f(folder, name): return SOLVERS[name]")
    code, start = toy.code(), f"{toy.name}.under_test:f"
    table = f"{toy.name}.solvers:solver"
    assert code.closure(start).tables == {table}
    found = code.all_kinds([start])
    assert found.keys() == {start, f"{table}[fast]", f"{table}[exact]"}
    before = {name: closure.digest for name, closure in found.items()}
    toy.edit("solvers.py", "return 1", "return 5")
    after = {name: closure.digest for name, closure in toy.code().all_kinds([start]).items()}
    assert [name for name in before if before[name] != after[name]] == [f"{table}[fast]"]


def test_another_import_under_the_same_name(toy):
    toy.write("under_test.py", "from math import sin as g\ndef f(folder): return g(1)")
    before = toy.code().closure(f"{toy.name}.under_test:f").digest
    toy.edit("under_test.py", "sin", "cos")
    assert toy.code().closure(f"{toy.name}.under_test:f").digest != before


def test_links_are_followed(toy, reached):
    toy.write("../rooms/models/x.py", "def g(): pass")
    (toy.folder / "models").symlink_to(toy.folder.parent / "rooms/models")
    assert reached("from ROOT.models.x import g\ndef f(folder): g()") == {"models.x.g"}


def test_one_code_notices_an_edit(toy):
    code, start = toy.code(), f"{toy.name}.middle:scaled"
    before = code.closure(start)
    toy.edit("words.py", "FACTOR = 3", "FACTOR = 30")
    code.refresh()
    assert code.closure(start) != before


def test_errors_name_what_is_wrong(toy):
    with pytest.raises(CodeError, match="not defined at the top level"):
        toy.code().closure(f"{toy.name}.words:missing")
    toy.write("words.py", "def (")
    with pytest.raises(SourceError, match=r"words\.py:1"):
        toy.code().closure(f"{toy.name}.middle:scaled")
