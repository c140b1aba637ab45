"""What the zoom of a lens changes beside the focal length: data only."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from mvp.fileedge import FileModel


class ZoomTable(FileModel):
    """Values at zoom steps, monotone cubics between them; an empty list: no change.

    ``pupil_offset_mm``: e. ``focus_shift_mm``: what the extension x = d - f is more than
    the focus axis says. ``centre_x_px``, ``centre_y_px``, ``k1`` (OpenCV's): instead of
    the camera's own. ``pupil_shift_mm``: how far the entrance pupil stands towards the
    object beyond what d says, from any origin. ``standard_deviation`` and ``left_out``:
    the largest one, and the root mean square error at nodes that were left out, by list.
    """

    steps: list[int] = Field(min_length=1)
    pupil_offset_mm: list[float] = Field(default_factory=list)
    focus_shift_mm: list[float] = Field(default_factory=list)
    centre_x_px: list[float] = Field(default_factory=list)
    centre_y_px: list[float] = Field(default_factory=list)
    k1: list[float] = Field(default_factory=list)
    pupil_shift_mm: list[float] = Field(default_factory=list)
    standard_deviation: dict[str, float] = Field(default_factory=dict)
    left_out: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _as_long_as_the_steps(self) -> Self:
        if any(b <= a for a, b in zip(self.steps, self.steps[1:], strict=False)):
            raise ValueError("the zoom steps must rise")
        for name, values in self.lists.items():
            if len(values) != len(self.steps):
                raise ValueError(f"{name} needs a value for each of the zoom steps")
        if bool(self.centre_x_px) != bool(self.centre_y_px):
            raise ValueError("centre_x_px and centre_y_px go together")
        return self

    @property
    def lists(self) -> dict[str, list[float]]:
        """The lists that say something, by name."""
        every = {
            "pupil_offset_mm": self.pupil_offset_mm,
            "focus_shift_mm": self.focus_shift_mm,
            "centre_x_px": self.centre_x_px,
            "centre_y_px": self.centre_y_px,
            "k1": self.k1,
            "pupil_shift_mm": self.pupil_shift_mm,
        }
        return {name: values for name, values in every.items() if values}
