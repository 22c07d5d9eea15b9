import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from multiprocessing import get_context
from pathlib import Path

import pytest

from fastac.store.recording import unrecorded
from fastac.store.steps import Step, StepError
from fastac.store.store import DAY_S, open_store

ROOT = Path(__file__).parents[3]


def slopes(toy, **changes) -> Step:
    return Step("slopes", toy.function("slopes"), {"scene": toy.scene(**changes)}, ("slopes.txt",))


def weights(toy, **changes) -> Step:
    return Step("weights", toy.function("weights"), {"scene": toy.scene(**changes)}, ("weights.txt",))


def solved(toy, **changes) -> Step:
    return Step("solved", toy.function("solved"), {"scene": toy.scene(**changes)})


def states(toy, step) -> list[tuple[str, str]]:
    seen = []
    toy.store().perform(step, lambda name, state: seen.append((name, state)))
    return seen


def test_a_result_is_kept(toy):
    store = toy.store()
    assert store.why(slopes(toy)) == "never performed"
    assert states(toy, slopes(toy)) == [("slopes", "running")]
    assert states(toy, slopes(toy)) == [("slopes", "kept")]
    entry = store.perform(slopes(toy))
    assert entry.path("slopes.txt").read_text() == "19"
    assert store.is_current(slopes(toy))
    assert store.why(slopes(toy)) == "current"


def test_a_relative_folder_is_one_of_the_current_directory(tmp_path, monkeypatch):
    stores = []
    for name in ("a", "b", "a"):
        (tmp_path / name).mkdir(exist_ok=True)
        monkeypatch.chdir(tmp_path / name)
        stores.append(open_store(Path("store")))
    assert [store.folder for store in stores] == [tmp_path / name / "store" for name in ("a", "b", "a")]
    assert stores[0] is stores[2]


def test_a_step_that_another_process_performs_meanwhile(toy, monkeypatch):
    """It is found where the store looks for why it is not current."""
    store = toy.store()
    store.perform(slopes(toy))
    monkeypatch.setattr(store, "_current", lambda inputs: None)
    assert store.is_current(slopes(toy))


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


def test_an_exception_leaves_nothing(toy):
    toy.write(
        "failing.py", "def fail(folder):\n    (folder / 'a').write_text('')\n    raise OSError('full')\n"
    )
    with pytest.raises(OSError, match="full"):
        toy.store().perform(Step("fail", toy.module("failing").fail, {}, ("a",)))
    assert not list(toy.kept.rglob("a"))
    assert not list((toy.kept / ".part").iterdir())


def test_a_missing_output_is_an_error(toy):
    with pytest.raises(StepError, match=r"wrote no other\.txt"):
        toy.store().perform(Step("bench", toy.function("bench"), {}, ("other.txt",)))


@pytest.mark.parametrize("harm", ["truncate", "remove", "same size"])
def test_a_damaged_output_is_redone(toy, harm):
    path = toy.store().perform(slopes(toy)).path("slopes.txt")
    path.chmod(0o644)
    if harm == "remove":
        path.unlink()
    else:
        path.write_text("" if harm == "truncate" else "20")
    assert "output slopes.txt" in toy.store().why(slopes(toy))
    entry = toy.store().perform(slopes(toy))
    assert entry.path("slopes.txt").read_text() == "19"
    assert len(list((toy.kept / "slopes").iterdir())) == 1


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("outputs",), {}),
        (("outputs",), 3),
        (("outputs", "slopes.txt", "files"), {"../../secret": [2, 3, "x"]}),
        (("outputs", "slopes.txt", "files"), {".": []}),
        (("tables",), None),
        (("codes",), [1]),
        (("reads", "scene"), "x"),
        (("inner",), {"../../elsewhere": {}}),
        (("seconds",), "long"),
    ],
)
def test_a_damaged_trace_says_nothing(toy, keys, value):
    trace = toy.store().perform(slopes(toy)).folder / "step.json"
    content = json.loads(trace.read_text())
    place = content
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    trace.write_text(json.dumps(content))
    entry = toy.store().perform(slopes(toy))
    assert entry.path("slopes.txt").read_text() == "19"
    assert entry.trace["seconds"] >= 0
    assert toy.store().is_current(slopes(toy))


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, "null"])
def test_a_trace_that_cannot_be_read(toy, text):
    trace = toy.store().perform(slopes(toy)).folder / "step.json"
    trace.write_text(text)
    assert toy.store().perform(slopes(toy)).path("slopes.txt").read_text() == "19"


def test_a_trace_elsewhere_is_not_followed(toy, tmp_path):
    trace = toy.store().perform(slopes(toy)).folder / "step.json"
    trace.rename(tmp_path / "step.json")
    trace.symlink_to(tmp_path / "step.json")
    assert not toy.store().is_current(slopes(toy))
    assert toy.store().perform(slopes(toy)).path("slopes.txt").read_text() == "19"


def test_verify_finds_what_sizes_and_times_hide(toy):
    path = toy.store().perform(slopes(toy)).path("slopes.txt")
    status = path.stat()
    path.chmod(0o644)
    path.write_text("20")
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert toy.store().is_current(slopes(toy))
    assert len(toy.store().verify()) == 1
    assert toy.store().perform(slopes(toy)).path("slopes.txt").read_text() == "19"
    assert toy.store().verify() == []


def test_an_edit_of_a_placed_file(toy, tmp_path):
    build = tmp_path / "build"
    build.mkdir()
    (build / "slopes.txt").write_text("the user's own")
    placed = toy.store().perform(slopes(toy)).place(build)["slopes.txt"]
    assert placed.read_text() == "19"
    toy.store().perform(slopes(toy)).place(build)
    assert [p.name for p in build.iterdir()] == ["slopes.txt"]
    placed.chmod(0o644)
    placed.write_text("77")
    entry = toy.store().perform(slopes(toy))
    assert entry.path("slopes.txt").read_text() == "19"
    entry.place(build)
    assert placed.read_text() == "19"


def test_copies_are_placed_where_links_cannot_be(toy, tmp_path, monkeypatch):
    def refuse(source, target):
        raise OSError("another file system")

    monkeypatch.setattr(os, "link", refuse)
    placed = toy.store().perform(slopes(toy)).place(tmp_path / "build")["slopes.txt"]
    placed.write_text("77")
    assert toy.store().is_current(slopes(toy))


FOLDERS = """
    def make(folder):
        (folder / "a/b").mkdir(parents=True)
        (folder / "a/b/c").write_text("1")
        (folder / "scratch").mkdir()
    """


def test_folders_are_outputs(toy, tmp_path):
    toy.write("folders.py", FOLDERS)
    step = Step("make", toy.module("folders").make, {}, ("a",))
    entry = toy.store().perform(step)
    assert sorted(p.name for p in entry.folder.iterdir()) == ["a", "step.json"]
    entry.place(tmp_path / "build")
    (tmp_path / "build/a/more").write_text("")
    assert (entry.place(tmp_path / "build")["a"] / "b/c").read_text() == "1"
    assert [p.name for p in (tmp_path / "build").iterdir()] == ["a"]
    assert [p.name for p in (tmp_path / "build/a").iterdir()] == ["b"]
    (entry.path("a") / "b/d").write_text("")
    assert toy.store().why(step) == "output a has other files"


def test_a_pool_of_threads_is_recorded(toy):
    toy.write(
        "pooled.py",
        """
        from concurrent.futures import ThreadPoolExecutor
        from ROOT.solvers import SOLVERS

        def pooled(folder, scene):
            with ThreadPoolExecutor(2) as pool:
                bits = pool.submit(lambda: scene.numbers.slope_bits).result()
                return bits + pool.submit(lambda: SOLVERS[scene.solver]().solve()).result()
        """,
    )

    def step(**changes):
        return Step("pooled", toy.module("pooled").pooled, {"scene": toy.scene(**changes)})

    assert toy.store().value(step()) == 17
    assert toy.store().why(step(numbers={"fraction_bits": 15})) == "scene numbers.slope_bits = 17 was 16"
    toy.edit("solvers.py", "return 2", "return 3")
    assert toy.store().is_current(step())
    toy.edit("solvers.py", "return 1", "return 4")
    assert toy.store().why(step()) == f"code {toy.name}.solvers.Fast changed"


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


def test_clean_removes_what_is_long_unused(toy):
    old = toy.store().perform(slopes(toy))
    toy.store().perform(weights(toy))
    long_ago = time.time() - 3 * DAY_S
    os.utime(old.folder / "step.json", (long_ago, long_ago))
    (toy.kept / ".part" / f"{'0' * 16}-left").mkdir()
    assert toy.store().clean(2) == [old.id]
    assert not toy.store().is_current(slopes(toy))
    assert toy.store().is_current(weights(toy))
    assert not list((toy.kept / ".part").iterdir())


def test_use_keeps_an_entry_from_being_cleaned(toy):
    entry = toy.store().perform(slopes(toy))
    os.utime(entry.folder / "step.json", (0, 0))
    toy.store().perform(slopes(toy))
    assert toy.store().clean(1) == []


def test_a_bucket_in_use_is_not_cleaned(toy):
    entry = toy.store().perform(slopes(toy))
    os.utime(entry.folder / "step.json", (0, 0))
    store = toy.store()
    with store._locked(entry.folder.name.partition("-")[0], lambda: None):
        assert toy.store().clean(1) == []
    assert toy.store().clean(1) == [entry.id]


SLOW = """
    import time
    from pathlib import Path

    def slow(folder, log):
        with open(log, "a") as file:
            file.write("x")
        for name in ("a", "b"):
            (folder / name).mkdir()
            (folder / name / "part").write_text("1")
            time.sleep(SECONDS)
    """
PERFORM = """
import sys, time
sys.path[:0] = [{root!r}, {toys!r}]
from pathlib import Path
from fastac.store.closure import Code
from fastac.store.steps import Step
from fastac.store.store import Store
from {name}.slow import slow
store = Store(Path({kept!r}), Code({{{name!r}: Path({folder!r})}}))
step = Step("slow", slow, {{"log": {log!r}}}, ("a", "b"))
store.perform(step, lambda name, state: print(state, flush=True))
print("done", flush=True)
"""


def script(toy) -> list[str]:
    names = {"root": str(ROOT), "toys": str(toy.folder.parent), "name": toy.name, "kept": str(toy.kept)}
    text = PERFORM.format(**names, folder=str(toy.folder), log=str(toy.folder / "log"))
    return [sys.executable, "-c", text]


def test_two_processes_do_it_once(toy):
    toy.write("slow.py", SLOW.replace("SECONDS", "0.4"))
    first = subprocess.Popen(script(toy), stdout=subprocess.PIPE, text=True)
    second = subprocess.Popen(script(toy), stdout=subprocess.PIPE, text=True)
    said = sorted(process.communicate(timeout=60)[0].split() for process in (first, second))
    assert (toy.folder / "log").read_text() == "x"
    assert ["running", "done"] in said
    # A process that starts too late to wait finds the result.
    assert ["waiting", "kept", "done"] in said or ["kept", "done"] in said


def _perform_from_fork(toy, barrier, said):
    barrier.wait()
    step = Step("slow", toy.module("slow").slow, {"log": str(toy.folder / "log")}, ("a", "b"))
    states = []
    toy.store().perform(step, lambda name, state: states.append(state))
    said.put(states)


def test_the_second_process_waits(toy):
    toy.write("slow.py", SLOW.replace("SECONDS", "0.3"))
    context = get_context("fork")
    barrier, said = context.Barrier(2), context.Queue()
    workers = [context.Process(target=_perform_from_fork, args=(toy, barrier, said)) for _ in range(2)]
    for worker in workers:
        worker.start()
    states = sorted(said.get(timeout=60) for _ in workers)
    for worker in workers:
        worker.join()
    assert states == [["running"], ["waiting", "kept"]]
    assert (toy.folder / "log").read_text() == "x"


@pytest.mark.parametrize("moment", ["begun", "first output", "second output"])
def test_a_kill_leaves_nothing_half_done(toy, moment):
    toy.write("slow.py", SLOW.replace("SECONDS", "60" if moment != "second output" else "0.1"))
    if moment == "second output":
        toy.edit("slow.py", "time.sleep(0.1)", "time.sleep(60 if name == 'b' else 0.1)")
    process = subprocess.Popen(script(toy), stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "running\n"
    wanted = {"begun": "log", "first output": "a/part", "second output": "b/part"}[moment]
    give_up = time.time() + 30
    while not list(toy.folder.parent.rglob(wanted)) and time.time() < give_up:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert not list((toy.kept / "slow").glob("*"))
    toy.write("slow.py", SLOW.replace("SECONDS", "0"))
    step = Step("slow", toy.module("slow").slow, {"log": str(toy.folder / "log")}, ("a", "b"))
    entry = toy.store().perform(step)
    assert (entry.path("b") / "part").read_text() == "1"
    assert not list((toy.kept / ".part").iterdir())


KILL = """
import os, signal
replace = os.replace
def killed(old, new):
    named = os.path.basename(os.path.dirname(new)) == "slow"
    if named and {when!r} == "before":
        os.kill(os.getpid(), signal.SIGKILL)
    replace(old, new)
    if named:
        os.kill(os.getpid(), signal.SIGKILL)
os.replace = killed
"""


@pytest.mark.parametrize(("when", "state"), [("before", "running"), ("after", "kept")])
def test_a_kill_around_the_renaming(toy, when, state):
    toy.write("slow.py", SLOW.replace("SECONDS", "0"))
    *python, text = script(toy)
    process = subprocess.run([*python, KILL.format(when=when) + text], stdout=subprocess.PIPE, timeout=60)
    assert process.returncode == -signal.SIGKILL
    step = Step("slow", toy.module("slow").slow, {"log": str(toy.folder / "log")}, ("a", "b"))
    assert states(toy, step) == [("slow", state)]
    assert not list((toy.kept / ".part").iterdir())


def test_threads_that_perform_other_steps_record_for_themselves(toy):
    toy.write(
        "meeting.py",
        """
        from ROOT.solvers import SOLVERS

        def meet(folder, name, meeting):
            meeting.wait(20)
            value = SOLVERS[name]().solve()
            meeting.wait(20)
            return value
        """,
    )
    meeting = threading.Barrier(2)

    def step(name):
        return Step("meet", toy.module("meeting").meet, {"name": name}, (), {"meeting": meeting})

    def perform(name):
        with unrecorded():
            toy.store().perform(step(name))

    toy.module("meeting")
    threads = [threading.Thread(target=perform, args=(name,)) for name in ("fast", "exact")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    toy.edit("solvers.py", "return 2", "return 3")
    assert toy.store().is_current(step("fast"))
    assert not toy.store().is_current(step("exact"))
