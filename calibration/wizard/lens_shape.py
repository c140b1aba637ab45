"""One target for all nodes of a lens session: what they say together about its shape.

A node's own few views separate principal distance and bow of the target only roughly. The
target is the same for all: each node is told what the others found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibration.target_shape import SHAPE_NAMES, FoundShape

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.camera import CameraEstimate
    from calibration.target_shape import ShapePrior
    from mvp.geometry import FloatArray

LENS_NAMES = ("fx_px", "cx_px", "cy_px", "k1")
_LENS = len(LENS_NAMES)


@dataclass(frozen=True, eq=False)
class SharedShape:
    """A node's numbers with what all nodes know of the target.

    Attributes:
        values: (4,) of ``LENS_NAMES``.
        covariance: (4, 4).
        shape: of the target, by all nodes.
    """

    values: FloatArray
    covariance: FloatArray
    shape: FoundShape


def shared(found: Sequence[CameraEstimate], prior: ShapePrior) -> list[SharedShape]:
    """Every node with the shape that all of them saw, to first order.

    Args:
        found: nodes whose fits had the shape of the target free.
        prior: that each of the fits had; it counts once.

    Raises:
        ValueError: a fit took the target at its word.
    """
    values = np.stack([_numbers(one) for one in found])
    information = np.linalg.inv(
        np.stack([one.estimate.block(LENS_NAMES + SHAPE_NAMES) for one in found])
    )
    own = np.linalg.inv(np.linalg.inv(information)[:, _LENS:, _LENS:])
    told = own - np.diag(prior.sigmas**-2)
    pull = np.einsum("nij,nj->ni", own, values[:, _LENS:])
    result = []
    for index, one in enumerate(found):
        others = np.arange(len(found)) != index
        joint, right = information[index].copy(), information[index] @ values[index]
        joint[_LENS:, _LENS:] += told[others].sum(axis=0)
        right[_LENS:] += pull[others].sum(axis=0)
        covariance = np.linalg.inv(joint)
        best = covariance @ right
        if one.shape is None:
            raise ValueError("a fit took the target at its word")
        shape = replace(one.shape.shape, values=best[_LENS:])
        result.append(
            SharedShape(
                best[:_LENS],
                covariance[:_LENS, :_LENS],
                FoundShape(shape, covariance[_LENS:, _LENS:]),
            )
        )
    return result


def _numbers(found: CameraEstimate) -> FloatArray:
    """(9,): of ``LENS_NAMES``, then of ``SHAPE_NAMES``."""
    if found.shape is None:
        raise ValueError("a fit took the target at its word")
    lens = [float(getattr(found.camera, name)) for name in LENS_NAMES]
    return np.concatenate([lens, found.shape.shape.values])
