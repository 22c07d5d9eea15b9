"""What gateware/stream/packet_input.py makes of packets, as a plain loop: the golden model of its marks."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Marked:
    """A beat for FrameGuard: `index` of the packet's beat, or None for the start of frame that is made up."""

    index: int | None
    last: bool
    start: bool


class PacketRules:
    """Marks of beats in the order in which they are accepted, for frames of `height` lines."""

    def __init__(self, height: int, line_beats: int):
        self.height, self.line_beats = height, line_beats
        self.place = 0

    def reset(self) -> None:
        """A hard reset: the next beat begins a packet, whatever it is."""
        self.place = 0

    def beat(self, index: int, *, last: bool) -> list[Marked]:
        """What goes to FrameGuard for a beat: itself, and behind a packet that is too short what ends its
        frame.

        last : `tlast`, the packet's end
        """
        place, total = self.place, self.height * self.line_beats
        surplus = place >= total
        line_ends = place % self.line_beats == self.line_beats - 1
        found = [Marked(index, last or (line_ends and not surplus), place == 0)]
        if last and place + 1 < total:
            found.append(Marked(None, True, True))
        self.place = 0 if last else place + 1
        return found
