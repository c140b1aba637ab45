"""A stepping motor between two mechanical ends, stepped by time."""

from __future__ import annotations

from dataclasses import dataclass, field

from pydantic import Field

from mvp.fileedge import FileModel


class Travel(FileModel):
    """Where a simulated motor can go, in steps of the lens table.

    Attributes:
        low: lower mechanical end.
        high: upper mechanical end.
        start: where it stands when the power comes on; left out, in the middle.
        reference: where its light barrier switches; None when it has none.
    """

    low: float
    high: float
    start: float | None = None
    reference: float | None = None

    @property
    def first(self) -> float:
        """Where it stands at first."""
        return (self.low + self.high) / 2 if self.start is None else self.start


class RateSettings(FileModel):
    """Share of the real speed at which simulated motors run; protocols keep theirs."""

    speed_scale: float = Field(default=1.0, gt=0, le=1000)


@dataclass(eq=False)
class Motor:
    """Turns by pulses; pulses against a mechanical end or a stalled shaft are lost.

    Attributes:
        travel: mechanical ends and light barrier.
        scale: factor on every rate.
        stalled: the shaft does not turn.
        place: where it truly stands, steps.
        pulses: given since the last ``go``, signed.
        begun: motions that were ever asked for.
    """

    travel: Travel
    scale: float = 1.0
    stalled: bool = False
    place: float = field(init=False)
    pulses: float = 0.0
    begun: int = 0
    _left: float = 0.0
    _rate: float = 0.0
    _last_s: float | None = None
    _until_barrier: bool = False

    def __post_init__(self) -> None:
        self.place = self.travel.first

    @property
    def moving(self) -> bool:
        """Whether pulses are still to be given."""
        return self._left != 0.0

    @property
    def barrier(self) -> bool:
        """Whether the light barrier is covered: from its place upwards."""
        reference = self.travel.reference
        return reference is not None and self.place >= reference

    def go(
        self, pulses: float, rate: float, now_s: float, *, until_barrier: bool = False
    ) -> None:
        """Give so many pulses, or stop earlier where the barrier switches.

        Args:
            pulses: signed; up is positive.
            rate: pulses per second.
            now_s: when the first one comes.
            until_barrier: whether the barrier ends the motion.
        """
        self.pulses, self._left = 0.0, pulses
        self.begun += 1
        self._rate = rate * self.scale
        self._last_s = now_s
        self._until_barrier = until_barrier

    def halt(self) -> None:
        """Give no more pulses."""
        self._left = 0.0

    def tick(self, now_s: float) -> float:
        """Let time pass; the pulses given meanwhile, signed."""
        if self._last_s is None or not self.moving:
            self._last_s = now_s
            return 0.0
        size = min(abs(self._left), self._rate * (now_s - self._last_s))
        self._last_s = now_s
        given = size if self._left > 0 else -size
        barrier = self._to_barrier(given)
        if barrier is not None:
            given, self._left = barrier, 0.0
        else:
            self._left = 0.0 if size == abs(self._left) else self._left - given
        self.pulses += given
        self._turn(given)
        if self._left == 0.0:
            self.place = round(self.place, 6)  # pulses are whole
        return given

    def _to_barrier(self, given: float) -> float | None:
        """Pulses up to where the barrier switches; None when it does not."""
        reference = self.travel.reference
        if reference is None or self.stalled or not self._until_barrier:
            return None
        if self.place < reference <= self.place + given:
            return reference - self.place
        if self.place + given < reference <= self.place:
            return reference - 1 - self.place
        return None

    def turn_by_hand(self, steps: float) -> None:
        """Move the shaft, as far as the mechanical ends let it, without a pulse."""
        self.place = min(max(self.place + steps, self.travel.low), self.travel.high)

    def _turn(self, given: float) -> None:
        if not self.stalled:
            self.turn_by_hand(given)
