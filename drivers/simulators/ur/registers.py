"""What RTDE clients and robot programs write and read: registers, inputs, outputs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from drivers.simulators.ur.variables import REGISTERS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivers.simulators.ur.wire import Value

_FIELDS = {"standard": (0, 8), "configurable": (8, 8), "tool": (16, 2)}


@dataclass
class Registers:
    """General-purpose registers and electrical inputs and outputs.

    Attributes:
        writes: how often each input was written, by name.
    """

    in_int: list[int] = field(default_factory=lambda: [0] * REGISTERS)
    in_double: list[float] = field(default_factory=lambda: [0.0] * REGISTERS)
    in_bits: int = 0
    out_int: list[int] = field(default_factory=lambda: [0] * REGISTERS)
    out_double: list[float] = field(default_factory=lambda: [0.0] * REGISTERS)
    out_bits: int = 0
    digital_inputs: int = 0
    digital_outputs: int = 0
    analog_inputs: list[float] = field(default_factory=lambda: [0.0, 0.0])
    analog_outputs: list[float] = field(default_factory=lambda: [0.0, 0.0])
    slider: float = 1.0
    writes: dict[str, int] = field(default_factory=dict)

    def apply(self, inputs: dict[str, Value]) -> None:
        """Take over one input package."""
        for name, value in inputs.items():
            self.writes[name] = self.writes.get(name, 0) + 1
            if name.startswith("input_"):
                self._register(name, value)
        for prefix, (shift, width) in _FIELDS.items():
            self._digital(inputs, prefix, shift, width)
        self._analog(inputs)
        if inputs.get("speed_slider_mask"):
            fraction = _number(inputs.get("speed_slider_fraction", self.slider))
            self.slider = min(max(0.0, fraction), 1.0)

    def set_output(self, bit: int, on: bool) -> None:
        """Switch one digital output."""
        mask = 1 << bit
        self.digital_outputs = (self.digital_outputs & ~mask) | (mask if on else 0)

    def _register(self, name: str, value: Value) -> None:
        _, kind, _, number = name.split("_", 3)
        if kind == "int":
            self.in_int[int(number)] = int(_number(value))
        elif kind == "double":
            self.in_double[int(number)] = _number(value)
        elif name.startswith("input_bit_registers"):
            shift = 0 if name.endswith("0_to_31") else 32
            self._bits(int(_number(value)), shift, 32)
        else:
            self._bits(int(_number(value)), int(number), 1)

    def _bits(self, value: int, shift: int, width: int) -> None:
        mask = ((1 << width) - 1) << shift
        self.in_bits = (self.in_bits & ~mask) | ((value << shift) & mask)

    def _digital(
        self, inputs: dict[str, Value], prefix: str, shift: int, width: int
    ) -> None:
        mask = int(_number(inputs.get(f"{prefix}_digital_output_mask", 0)))
        value = int(_number(inputs.get(f"{prefix}_digital_output", 0)))
        for bit in range(width):
            if mask >> bit & 1:
                self.set_output(shift + bit, bool(value >> bit & 1))

    def _analog(self, inputs: dict[str, Value]) -> None:
        mask = int(_number(inputs.get("standard_analog_output_mask", 0)))
        for k in range(2):
            if mask >> k & 1:
                share = _number(inputs.get(f"standard_analog_output_{k}", 0.0))
                self.analog_outputs[k] = min(max(0.0, share), 1.0)


def _number(value: Value) -> float:
    """A scalar as a number."""
    return float(cast("float", value))


class Ownership:
    """Which connection may write which input; one owner each, until it hangs up."""

    def __init__(self) -> None:
        self.reserved: set[str] = set()
        self._owners: dict[str, object] = {}

    def taken(self, name: str, client: object) -> bool:
        """Whether somebody else, or a field bus, has this input."""
        owner = self._owners.get(name)
        return name in self.reserved or (owner is not None and owner is not client)

    def take(self, names: Iterable[str], client: object) -> None:
        """Give inputs to a connection."""
        self._owners.update(dict.fromkeys(names, client))

    def release(self, client: object) -> None:
        """Free what a connection had."""
        self._owners = {n: c for n, c in self._owners.items() if c is not client}
