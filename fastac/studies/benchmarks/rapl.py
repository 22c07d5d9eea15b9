"""Energy used by the processor packages, from their RAPL counters (Linux powercap, `intel-rapl:*`)."""

from pathlib import Path

POWERCAP = Path("/sys/class/powercap")


class NoCounters(OSError):
    """The platform has no readable energy counters; the message is one line that says why."""


class PackageCounters:
    """The energy counters of all processor packages; each wraps around at its own range."""

    def __init__(self, root: Path = POWERCAP):
        """Find the counters below `root`. Raises NoCounters where there are none or they cannot be read."""
        self.zones = sorted(zone for zone in root.glob("intel-rapl:*") if zone.name.count(":") == 1)
        if not self.zones:
            raise NoCounters(f"{root}: no intel-rapl: the platform has no energy counters")
        try:
            self.ranges_uj = [int((zone / "max_energy_range_uj").read_text()) for zone in self.zones]
            self.read_uj()
        except (OSError, ValueError) as error:
            raise NoCounters(f"{root}: intel-rapl cannot be read: {error}") from None

    def read_uj(self) -> list[int]:
        """Present value of each package's counter in µJ."""
        return [int((zone / "energy_uj").read_text()) for zone in self.zones]

    def spent_mj(self, before_uj: list[int], after_uj: list[int]) -> float:
        """Energy in mJ of all packages between two readings, each less than one range apart."""
        spent_uj = 0
        for before, after, top in zip(before_uj, after_uj, self.ranges_uj, strict=True):
            spent_uj += after - before + (top if after < before else 0)
        return 1e-3 * spent_uj
