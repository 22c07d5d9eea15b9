"""The host's software in the fault campaign: programs, generators that yield register accesses one by one."""

from fastac.gateware.bus.register_map import ERRORS
from fastac.sim.benches.host import DECERR, OKAY, SLVERR

ENABLE, SOFT_RESET, INTERRUPT, RESTART = 1, 4, 8, 16
BUSY, LOADING = 1, 8
MARKS = 0b10110
"""STATUS.result_valid, last_frame_bad and last_frame_suspect."""
POLLS = 3000
"""Readings after which a register that does not change counts as stuck."""


def error_names(value: int) -> set[str]:
    return {name for k, name in enumerate(ERRORS) if value >> k & 1}


class Host:
    """Programs for the hardware that `settings` describe.

    Each yields (address,) to read or (address, data, strobe) to write, and is sent (data, response).

    loads : while a word of a calibration is written, the image that it completes, or "part"
    loaded : an image found complete after a reset; reset_wanted : see `calibrate`
    """

    def __init__(self, settings: dict, rng):
        self.settings, self.rng = settings, rng
        self.address: dict[str, int] = settings["registers"]
        self.refusals = (DECERR, SLVERR) if settings["bus_errors"] == "respond" else (OKAY, OKAY)
        self.loads = self.loaded = ""
        self.reset_wanted = False

    def read(self, name: str):
        data, response = yield (self.address[name],)
        assert response == OKAY, f"{name}: response {response}"
        return data

    def write(self, name: str, data: int, response: int = OKAY, strobe: int = 0xF):
        _, found = yield self.address[name], data, strobe
        assert found == response, f"{name}: response {found} to a write, expected {response}"

    def expect(self, name: str, expected: int):
        found = yield from self.read(name)
        assert found == expected, f"{name}: {found:#x}, expected {expected:#x}"

    def initialise(self):
        """After a hard reset."""
        yield from self.write("CONTROL", ENABLE | INTERRUPT)
        yield from self.write("FRAME_TIMEOUT", self.settings["timeout"])

    def control(self, value: int):
        yield from self.write("CONTROL", value)

    def wait_until_idle(self):
        for _ in range(POLLS):
            if not (yield from self.read("STATUS")) & BUSY:
                return
        raise AssertionError("STATUS.busy stays")

    def wait_for_error(self, name: str):
        """Until this error comes, from now on."""
        yield from self.write("ERRORS", 1 << ERRORS.index(name))
        for _ in range(POLLS):
            if name in error_names((yield from self.read("ERRORS"))):
                return
        raise AssertionError(f"ERRORS.{name} does not come")

    def result(self):
        """The last result: number of its frame (0 without a force), forces and behind them slip,
        FRAME_VALIDITY, marks of STATUS.

        None if another result came meanwhile.
        """
        numbered = "FORCE_SEQUENCE" in self.address
        number = (yield from self.read("FORCE_SEQUENCE")) if numbered else 0
        forces = []
        for axis in self.settings["axes"]:
            low = yield from self.read(f"FORCE_{axis.upper()}_LOW")
            value = (yield from self.read(f"FORCE_{axis.upper()}_HIGH")) << 32 | low
            forces.append(value - (1 << 64) if value >> 63 else value)
        for name in ("SLIP_SPREAD", "SLIP_DOTS"):
            if name in self.address:
                forces.append((yield from self.read(name)))
        validity = yield from self.read("FRAME_VALIDITY")
        marks = (yield from self.read("STATUS")) & MARKS
        again = (yield from self.read("FORCE_SEQUENCE")) if numbered else 0
        return (number, forces, validity, marks) if again == number else None

    def read_all(self):
        """Every register; constant ones have their values."""
        for name in self.rng.sample(sorted(self.address), len(self.address)):
            found = yield from self.read(name)
            expected = self.settings["constants"].get(name, found)
            assert found == expected, f"{name}: {found:#x}, expected {expected:#x}"

    def absent(self, count: int):
        """Reads and writes where no register is."""
        for _ in range(count):
            address = self.rng.choice(self.settings["absent"])
            if self.rng.random() < 0.5:
                found = yield (address,)
                assert found == (0, self.refusals[0]), f"{address:#x}: read {found}"
            else:
                _, response = yield address, self.rng.getrandbits(32), self.rng.getrandbits(4)
                assert response == self.refusals[0], f"{address:#x}: response {response} to a write"

    def refused(self, count: int):
        """Writes to read-only registers, and writes of no byte, which change nothing."""
        constants = self.settings["constants"]
        for _ in range(count):
            name = self.rng.choice(self.settings["read_only"])
            yield from self.write(name, self.rng.getrandbits(32), self.refusals[1])
            if name in constants:
                yield from self.expect(name, constants[name])
        yield from self.write("FRAME_TIMEOUT", self.rng.getrandbits(32), strobe=0)
        yield from self.expect("FRAME_TIMEOUT", self.settings["timeout"])

    def endless(self, kind: str):
        """One access after another, of which a reset cuts one short."""
        while True:
            if kind == "read":
                yield from self.read(self.rng.choice(sorted(self.address)))
            else:
                yield from self.write("FRAME_TIMEOUT", self.settings["timeout"])

    def refused_word(self, word: int):
        """A word of CALIBRATION that the hardware must refuse."""
        yield from self.write("CALIBRATION", word, self.refusals[1])
        yield from self.expect("CALIBRATION_RECEIVED", 0)

    def calibrate(self, image: str, *, cut: float | None = None, by: str = "", resumes: bool = False):
        """Load an image, from the word on that the hardware waits for.

        cut : the share of its words after which something happens: "restart" begins again, "soft_reset" goes
            on with the next word, and at "hard_reset" `reset_wanted` is set, which ends this program some
            clocks later
        resumes : a hard reset ended this program; it may have been after the last word
        """
        words = self.settings["words"][image]
        place = yield from self.read("CALIBRATION_RECEIVED")
        if resumes and not place and (yield from self.read("BUNDLE_HASH_LOW")) == self._hash(image)[0]:
            self.loaded = image
            return
        stop = -1 if cut is None else 1 + int(cut * (len(words) - 2))
        while place < len(words):
            if place == stop:
                stop = -1
                yield from self.expect("CALIBRATION_RECEIVED", place)
                yield from self.expect("BUNDLE_HASH_LOW", 0)
                if by == "restart":
                    yield from self.write("CONTROL", ENABLE | INTERRUPT | RESTART)
                    place = 0
                elif by == "soft_reset":
                    yield from self.write("CONTROL", ENABLE | INTERRUPT | SOFT_RESET)
                else:
                    self.reset_wanted = True
                yield from self.expect("CALIBRATION_RECEIVED", place)
                assert (yield from self.read("STATUS")) & LOADING, "STATUS.loading has fallen"
            self.loads = image if place == len(words) - 1 else "part"
            yield from self.write("CALIBRATION", words[place])
            self.loads = ""
            place += 1
        yield from self.expect("CALIBRATION_RECEIVED", 0)
        for name, value in zip(("BUNDLE_HASH_LOW", "BUNDLE_HASH_HIGH"), self._hash(image), strict=True):
            yield from self.expect(name, value)

    def _hash(self, image: str) -> tuple[int, int]:
        value = self.settings["hash"][image]
        return value & 0xFFFFFFFF, value >> 32
