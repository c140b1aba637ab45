"""At how many settings a lens is measured: data only."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from mvp.fileedge import FileModel

_Length = Annotated[float, Field(gt=0)]


class LensGrid(FileModel):
    """How many settings of each motor ``mvp-cell calibrate lens`` measures.

    ``f_mm``: the zoom range that is measured, or the one focal length that is used; left
    out, all that the present table holds. One zoom makes a table of that zoom alone.
    """

    zooms: int = Field(default=4, ge=1, le=40)
    focuses: int = Field(default=5, ge=2, le=40)
    irises: int = Field(default=4, ge=2, le=40)
    f_mm: _Length | tuple[_Length, _Length] | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if isinstance(self.f_mm, tuple) and self.f_mm[0] > self.f_mm[1]:
            raise ValueError("f_mm needs the smaller focal length first")
        return self
