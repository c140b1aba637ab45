"""Nodes of a lens session: d's camera fit, and the sharp distance by blur over depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from calibration.camera_start import poses_with
from calibration.camera_verdict import NOISE_CODE
from calibration.lens_table import LensNode, Measured, PixelGrid, node_from_views
from calibration.lens_table.edge_blur import EdgeBlurs, edge_blurs, optics_of
from calibration.lens_table.sharpness import sharp_place
from calibration.projection import PinholeCamera, project
from calibration.wizard.camera_views import LARGEST_NOISE_PX, shape_prior
from calibration.wizard.lens_nodes import NODE, samples_of
from calibration.wizard.lens_plan import NodePlan
from calibration.wizard.lens_shape import shared
from calibration.wizard.lens_travel import measured, share_of, stops_of
from calibration.wizard.lookout import layout_of, target_of
from calibration.wizard.points import points_of
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration.bundle import BundleState
    from calibration.camera import CameraEstimate
    from calibration.observations import Observations
    from calibration.target_shape import FoundShape
    from calibration.verdict import Cause
    from calibration.wizard.lens_shape import SharedShape
    from calibration.wizard.session_store import Sample, SessionStore
    from mvp.calibrated import PointResiduals
    from mvp.geometry import FloatArray

PLAN = "nodes"
_LEAST_VIEWS = 3


@dataclass(frozen=True, eq=False)
class NodeResult:
    """One node as measured.

    Attributes:
        node: for the table.
        camera: as measured at this setting.
        pictures: the camera fit and what it was made from; None for a travel.
        points: residuals of every view or stop.
        shape: of the target, by all nodes; None for a travel.
    """

    node: LensNode
    camera: PinholeCamera
    pictures: tuple[CameraEstimate, Observations] | None = None
    points: tuple[PointResiduals, ...] = ()
    shape: FoundShape | None = None


def plan_of(store: SessionStore) -> tuple[NodePlan, ...]:
    """The nodes of the session, as they were planned."""
    known = store.recall(PLAN)
    rows = known if isinstance(known, list) else []
    plans = []
    for row in rows:
        zoom, focus, iris, sharp, *tilts = cast("list[float]", row)
        steps = int(zoom), int(focus), int(iris)
        plans.append(NodePlan(*steps, float(sharp), tilts=all(tilts)))
    return tuple(plans)


def nodes_of(store: SessionStore) -> list[NodeResult]:
    """All nodes with enough views, each with what all know of the target."""
    found = [one for plan in plan_of(store) if (one := node_of(store, plan))]
    fits = [one.pictures[0] for one in found if one.pictures]
    if not fits:
        return found
    told = iter(shared(fits, shape_prior(store.facts)))
    pitch = store.facts.sensor.pitch_x_mm
    return [_with(one, next(told), pitch) if one.pictures else one for one in found]


def _with(one: NodeResult, told: SharedShape, pitch_x_mm: float) -> NodeResult:
    """A node with the numbers that all of them give it."""
    values = [float(value) for value in told.values]
    own = one.node
    node = LensNode.from_camera(
        (own.zoom, own.focus),
        values,
        told.covariance,
        pitch_x_mm=pitch_x_mm,
        sharp_mm=own.sharp_mm,
        pupil_mm=own.pupil_mm,
        fill=own.fill,
    )
    fx, cx, cy, k1 = values
    fy = fx * one.camera.fy_px / one.camera.fx_px
    camera = replace(one.camera, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, k1=k1)
    return replace(one, node=node, camera=camera, shape=told.shape)


def target_causes(nodes: Sequence[NodeResult]) -> tuple[Cause, ...]:
    """What the target and the residuals of the nodes say against a table."""
    shapes = [one.shape for one in nodes if one.shape]
    noisy = tuple(
        replace(cause, message=f"zoom {one.node.zoom} focus {one.node.focus}: {text}")
        for one in nodes
        for cause in (one.pictures[0].verdict.causes if one.pictures else ())
        if cause.code == NOISE_CODE and (text := cause.message)
    )
    return (*(shapes[0].causes() if shapes else ()), *noisy)


def on_the_target(seen: Observations, nodes: Sequence[NodeResult]) -> Observations:
    """The points where a target lies that the nodes found not to be as stated."""
    shapes = [one.shape for one in nodes if one.shape and one.shape.found]
    if not shapes:
        return seen
    moved = shapes[0].shape.moved(seen.points_target_mm)
    return replace(seen, points_target_mm=moved)


def node_of(store: SessionStore, plan: NodePlan) -> NodeResult | None:
    """One node from its views or its travel; None with too few of them."""
    if not plan.tilts:
        return _from_travel(store, plan)
    samples = samples_of(store.usable(NODE), plan.zoom, plan.focus)
    if len(samples) < _LEAST_VIEWS:
        return None
    sensor = store.facts.sensor
    seen = store.observations(samples)
    node, found = node_from_views(
        seen,
        (plan.zoom, plan.focus),
        PixelGrid(
            sensor.pitch_x_mm, sensor.pitch_y_mm, largest_noise_px=LARGEST_NOISE_PX
        ),
        shape=shape_prior(store.facts),
        folds=0,
    )
    sharp = _sharp(store, samples, found.state, node.f_cal_mm)
    points = points_of(samples, found.errors_px)
    return NodeResult(
        replace(node, sharp_mm=sharp), found.camera, (found, seen), points
    )


def _from_travel(store: SessionStore, plan: NodePlan) -> NodeResult | None:
    """A node from a squarely faced target and a travel."""
    sensor = store.facts.sensor
    try:
        found = measured(store, plan)
    except CalibrationError:
        return None
    node = found.node(
        (plan.zoom, plan.focus),
        pitch_x_mm=sensor.pitch_x_mm,
        fill=share_of(store, plan),
    )
    f_px, cx, cy, k1 = (float(value) for value in found.lens)
    ratio = sensor.pitch_x_mm / sensor.pitch_y_mm
    camera = PinholeCamera(f_px, f_px * ratio, cx, cy, k1)
    samples = stops_of(store, plan)
    seen = store.observations(samples)
    state = poses_with(camera, seen)
    sharp = _sharp(store, samples, state, node.f_cal_mm)
    foretold = [
        project(camera, *pose, seen.of_view(k)[0])
        for k, pose in enumerate(zip(state.rotation, state.translation_mm, strict=True))
    ]
    points = points_of(samples, np.concatenate(foretold) - seen.pixels)
    return NodeResult(replace(node, sharp_mm=sharp), camera, points=points)


def _sharp(
    store: SessionStore,
    samples: Sequence[Sample],
    state: BundleState[PinholeCamera],
    f_cal_mm: float,
) -> Measured | None:
    """Where it is sharp, by how blurred edges at all depths are; None: they do not tell."""
    target = target_of(store.facts)
    blurs = [
        blur_of(
            store,
            sample,
            state.camera,
            (state.rotation[k], state.translation_mm[k]),
        )
        for k, sample in enumerate(samples)
    ]
    try:
        return sharp_place(
            EdgeBlurs.joined(blurs),
            f_cal_mm,
            store.facts.sensor.pitch_y_mm,
            scale_sigma=target.square_sigma_mm / target.square_mm,
        ).distance_mm
    except CalibrationError:
        return None


def blur_of(
    store: SessionStore,
    sample: Sample,
    camera: PinholeCamera,
    pose: tuple[FloatArray, FloatArray],
) -> EdgeBlurs:
    """Blur of the edges in a stored picture."""
    facts = store.facts
    pitch = facts.sensor.pitch_y_mm
    picture = store.image(sample)
    grey = picture if picture.dtype == np.uint8 else picture / (sample.full_scale / 255)
    a_mm = facts.lens_at(sample.lens_steps).a_mm
    optics = optics_of(
        camera.fy_px * pitch, a_mm, pitch_mm=pitch, lambda_mm=facts.wavelength_mm
    )
    return edge_blurs(
        grey.astype(np.uint8), layout_of(target_of(facts)), camera, pose, optics
    )
