"""The report of a calibration: complete, self-contained, escaped, true to the numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibration.camera import CameraOptions, calibrate_camera
from calibration.hand_eye import Rehearsal, RobotNoise, calibrate_hand_eye, rehearse
from calibration.lens_table import (
    BothSides,
    Conditions,
    LensMeasurements,
    LensNode,
    Measured,
    build_tables,
    measure_hysteresis,
)
from calibration.observations import Observations
from calibration.part_pose import (
    HandEye,
    PartSight,
    PartView,
    SeenEdges,
    SeenPoints,
    judge_located,
    judge_resection,
    locate,
    own_shares,
    resect,
)
from calibration.part_pose.problem import PoseProblem
from calibration.projection import PinholeCamera, project
from calibration.report import (
    About,
    LeftOut,
    PartPicture,
    Photo,
    camera_report,
    hand_eye_report,
    lens_report,
    part_report,
    refused_report,
    write_report,
)
from calibration.report.numbers import sigma_text, value_text
from calibration.report.plots import (
    Coverage,
    ErrorBudget,
    ResidualField,
    Scene,
    Slack,
    ViewBars,
)
from calibration.report.scene import frustums
from calibration.report.write import render_report as render
from calibration.verdict import judged
from calibration.wizard.comparison import Comparison, Difference
from mvp.errors import CalibrationError, OutputError
from mvp.geometry import Pose
from mvp.optics import Sensor
from mvp.testing.paraxial_lens import ParaxialLens

EVIL = '<script>alert("1")</script> & $x^2$'
CAMERA = PinholeCamera(2376.4, 2376.4, 806.0, 595.0, k1=-0.12)
SIZE = (1600, 1200)
SPEC = RobotNoise(0.2, float(np.radians(0.05)))


def board(columns=9, rows=7, square_mm=25.0):
    grid = np.zeros((columns * rows, 3))
    grid[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2) * square_mm
    return grid - grid.mean(axis=0)


@cache
def camera_case(views=5, names=()):
    rng = np.random.default_rng(4)
    points, pixels = board(), []
    for angle in 2 * np.pi * np.arange(views) / views:
        tilt = np.radians(33) * np.array([np.cos(angle), np.sin(angle), 0])
        place = np.array([20 * np.cos(2 * angle), 15 * np.sin(angle), 480.0])
        seen = project(CAMERA, Rotation.from_rotvec(tilt).as_matrix(), place, points)
        pixels.append(seen + rng.normal(0, 0.15, seen.shape))
    seen = Observations.from_views(
        [points] * views, pixels, size_px=SIZE, names=names or ()
    )
    free = ("fx_px", "fy_px", "cx_px", "cy_px", "k1")
    return calibrate_camera(
        seen, CameraOptions(free=free, sigma_px=0.15, folds=2)
    ), seen


def photos(seen):
    grey = np.full((120, 160), 90, np.uint8)
    return tuple(
        Photo(name, grey, seen.of_view(i)[1] / 10, f"images/{i:04d}.png")
        for i, name in enumerate(seen.names)
    )


CHANGED = Comparison(
    "camera",
    "2026-01-01",
    "2026-02-01",
    (Difference("largest shift at 400 mm", 0.31, 0.05, "mm"),),
    6.2,
    ("the previous values were nominal",),
    "Largest shift at 400 mm: 0.31 mm, 6.2 standard deviations: something has changed.",
)


def camera_page(**changes):
    found, seen = camera_case()
    about = About(
        "camera CAM-1 of cell virtual",
        True,
        (("date", "2026-02-01"), ("target", "chessboard 9 x 7, 25 mm")),
        photos(seen),
        (LeftOut("view 9", "edges are 9 px wide", "focus"),),
        CHANGED,
        (("input sha256", "ab" * 32),),
    )
    return camera_report(
        found, seen, replace(about, **changes), distance_mm=400.0, target_share=1e-3
    )


@cache
def hand_eye_case(mount):
    plan = Rehearsal(
        views=12, robot=SPEC, columns=5, rows=4, pitch_mm=25.0, mount=mount
    )
    seen = rehearse(plan, np.random.default_rng(11))
    return calibrate_hand_eye(seen.data, plan.camera, SPEC), seen.data


def hand_eye_page(mount="eye-in-hand", **changes):
    result, data = hand_eye_case(mount)
    return hand_eye_report(
        replace(result, **changes),
        data,
        About("camera on the hand"),
        robot=SPEC,
        stand_off_mm=400.0,
    )


def lens_page():
    rng = np.random.default_rng(1)
    found = []
    for zoom, f in ((0, 8.0), (1500, 12.0), (3000, 18.0)):
        for focus in (0, 2500, 5000, 8000):
            d = f + 0.1 + 1.375e-4 * focus
            lens = ParaxialLens.thin(f_mm=f, d_mm=d, e_mm=2.4, a_mm=1.0)
            sigma = np.array([0.002, 0.35, 0.35, 1e-5])
            values = np.array([float(lens.scale(99.0)) * 99.0, 800, 600, 1e-3])
            far = lens.sharp_from_pupil_mm()
            sharp = Measured(far * (1 + rng.normal(0, 0.005)), far * 0.005)
            values = values + rng.normal(0, sigma)
            found.append(LensNode(zoom, focus, values, np.diag(sigma**2), sharp))
    steps = np.array([100, 300, 500])
    below = 1e-4 * (steps[:, None] + rng.normal(0, 1, (3, 4)))
    above = 1e-4 * (steps[:, None] + 30 + rng.normal(0, 1, (3, 4)))
    sides = measure_hysteresis(BothSides(steps, below, above, np.full(3, 1e-4)))
    iris = {s: Measured(0.4 * 10 ** (s / 600), 0.005) for s in range(0, 601, 150)}
    tables = build_tables(
        LensMeasurements(
            found,
            iris,
            blur_limit_mm=0.0135,
            hysteresis={"zoom": sides, "focus": sides, "iris": sides},
            conditions=Conditions(21.5, "operator"),
        )
    )
    sensor = Sensor(1600, 1200, 0.0055, 0.0055)
    pictures = [camera_case()]
    return lens_report(
        tables, About("lens L-1"), sensor=sensor, distance_mm=400.0, pictures=pictures
    )


def part_pictures(count=3):
    rng = np.random.default_rng(2)
    cube = 25.4 * (
        np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) - 0.5
    )
    part = Pose.from_rotvec("base", "part", [0.1, 0.2, 0.4], [400.0, 50.0, 60.0])
    x = Pose.from_rotvec("tool", "camera", [0.02, -0.03, 1.5], [10.0, 60.0, 90.0])
    eye = HandEye(
        x,
        np.diag([0.2, 0.2, 0.3, 5e-4, 5e-4, 5e-4]) ** 2,
        np.diag([0.1, 0.1, 0.1, 3e-4, 3e-4, 3e-4]) ** 2,
    )
    found = []
    for number in range(count):
        turn = Rotation.from_euler("xyz", [200, 30 - 20 * number, 50 * number], True)
        shown = Pose(
            "camera", "part", turn.as_matrix(), np.array([3.0 * number, 2, 360])
        )
        depth = shown.apply(cube)[:, 2]
        corners = cube[np.argsort(depth)[:7]]
        pixels = project(CAMERA, shown.rotation, shown.translation_mm, corners)
        ends = np.array([[corners[0], corners[1]]])
        places = project(
            CAMERA, shown.rotation, shown.translation_mm, np.linspace(*ends[0], 6)
        )
        sight = PartSight(
            SeenPoints(corners, pixels + rng.normal(0, 0.1, pixels.shape), 0.1),
            edges=SeenEdges(ends, places, np.zeros(6, np.int64), 0.1),
        )
        resection = resect(CAMERA, sight)
        best = resection.best
        tool = part @ shown.inverse() @ x.inverse()
        view = PartView(best.camera_from_part, best.estimate.covariance, tool)
        found.append(
            PartPicture(f"view {number + 1}", CAMERA, SIZE, sight, resection, view)
        )
    return found, eye


def part_page():
    pictures, eye = part_pictures()
    located = locate([p.view for p in pictures], eye)
    causes = [judge_resection(p.sight, p.resection).causes for p in pictures]
    return part_report(
        located,
        pictures,
        eye,
        About("part of cell virtual"),
        verdict=judged(judge_located(located).causes, *causes),
    )


PAGES = {
    "camera": camera_page,
    "hand-eye": hand_eye_page,
    "lens": lens_page,
    "part": part_page,
}


class Page(HTMLParser):
    """Balanced tags, all that is fetched, all links, and the text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.sources, self.links, self.ids, self.words = [], [], [], [], []
        self.tags = set()
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        named = dict(attrs)
        self.ids += [named["id"]] if "id" in named else []
        self.sources += [named[k] for k in ("src",) if k in named]
        if tag in ("image", "use", "link"):
            self.sources.append(named["href"])
        if tag == "a":
            self.links.append(named["href"])
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.mark.parametrize("kind", PAGES)
def test_every_page_is_whole_fetches_nothing_and_explains_every_plot(kind, tmp_path):
    data = PAGES[kind]()
    path = write_report(tmp_path, data)
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    page = Page(path.read_text(encoding="utf-8"))
    assert page.sources
    assert all(s.startswith("data:image/") for s in page.sources)
    assert "script" not in page.tags
    for plot in data.plots:
        assert " ".join(plot.how_to_read.split()) in page.text
        assert " ".join(plot.good.split()) in page.text
    for cause in data.verdict.causes:
        assert cause.message in page.text
        assert cause.action in page.text
    for quantity in data.quantities:
        assert quantity.name in page.text
        assert value_text(quantity.value, quantity.sigma) in page.text
    assert data.headline in page.text
    inner = [link[1:] for link in page.links if link.startswith("#")]
    assert set(inner) <= set(page.ids)
    assert len(set(page.ids)) == len(page.ids)


def shown(data, *kinds):
    """The page with some kinds of plots only."""
    return replace(data, plots=tuple(p for p in data.plots if isinstance(p, kinds)))


def test_the_same_numbers_give_the_same_bytes():
    page = shown(camera_page(), Coverage, ViewBars)
    assert render(page) == render(page)


def test_the_page_of_a_lens_shows_every_view_with_its_residual_and_its_place():
    data = lens_page()
    (bars,) = (plot for plot in data.plots if isinstance(plot, ViewBars))
    (scene,) = (plot for plot in data.plots if isinstance(plot, Scene))
    found, seen = camera_case()
    assert bars.names == scene.names == seen.names
    assert bars.values == pytest.approx(found.view_rms_px)
    assert scene.cameras.shape == (len(seen.names), 4, 4)


def test_bars_lead_to_pictures_and_pictures_to_their_files():
    page = Page(render(shown(camera_page(), ViewBars)))
    assert "#picture-0" in page.links
    assert "images/0000.png" in page.links


def test_pictures_of_one_name_are_told_apart():
    twice = (Photo("view 1"), Photo("view 1"))
    page = Page(render(shown(camera_page(photos=twice), ViewBars)))
    assert page.ids == ["picture-0", "picture-1"]
    assert "#picture-0" in page.links


def test_names_are_escaped_wherever_they_come_from():
    found, seen = camera_case(names=(EVIL, "b", "c", "d", "e"))
    about = About(
        EVIL,
        facts=((EVIL, EVIL),),
        photos=(Photo(EVIL, np.zeros((9, 9), np.uint8), link="javascript:alert(1)"),),
        left_out=(LeftOut(EVIL, EVIL, EVIL),),
        comparison=replace(CHANGED, words=EVIL, remarks=(EVIL,)),
        provenance=((EVIL, EVIL),),
    )
    data = camera_report(found, seen, about, distance_mm=400.0)
    text = render(shown(data, ViewBars))
    assert "<script" not in text
    page = Page(text)
    assert EVIL in page.text
    assert not [link for link in page.links if link.startswith("javascript:")]


def test_names_like_formulas_do_not_break_a_figure():
    result, data = hand_eye_case("eye-in-hand")
    names = tuple(f"$x^{i}_" for i in range(12))
    odd = replace(data, seen=replace(data.seen, names=names))
    page = hand_eye_report(result, odd, About("hand"), robot=SPEC, stand_off_mm=400.0)
    assert "$x^3_" in Page(render(shown(page, Slack, ViewBars))).text


def test_a_verdict_without_a_solution_still_has_a_page():
    page = hand_eye_page(solution=None)
    text = Page(render(page)).text
    assert "do not allow one to be believed" in text
    assert "Were the robot's numbers understood?" in text


def test_data_that_allow_no_result_have_a_page_that_says_why():
    error = CalibrationError("view 3: points on a line", hint="take it again")
    text = Page(render(refused_report("camera", error, About("camera")))).text
    assert "NO-GO" in text
    assert "view 3: points on a line" in text
    assert "take it again" in text


def test_an_alarm_of_the_comparison_is_seen():
    text = render(shown(camera_page()))
    assert re.search(r'class="cause">Largest shift', text)
    calm = render(shown(camera_page(comparison=replace(CHANGED, sigmas=1.0))))
    assert re.search(r'class="agree">Largest shift', calm)


def test_coverage_counts_every_point_once_in_its_field():
    pixels = np.array([[-0.5, -0.5], [0.0, 0.0], [1599.4, 1199.4], [799.0, 10.0]])
    counts = Coverage.of(pixels, SIZE).counts
    assert counts.sum() == 4
    assert counts[0, 0] == 2
    assert counts[5, 7] == 1
    assert counts[0, 3] == 1


def test_the_budget_is_the_root_of_the_squares():
    page = camera_page()
    budget = next(p for p in page.plots if isinstance(p, ErrorBudget))
    parts = [part.sigma_mm for part in budget.parts]
    assert budget.total_mm == pytest.approx(np.sqrt(np.sum(np.square(parts))))
    assert budget.parts[1].name == "pixel noise"
    assert budget.parts[1].sigma_mm == pytest.approx(
        0.15 * 400 / CAMERA.fx_px, rel=0.01
    )


def test_the_residual_of_an_edge_is_its_distance_from_the_predicted_line():
    pictures, _ = part_pictures(1)
    edges, pose = pictures[0].sight.edges, pictures[0].view.camera_from_part
    problem = PoseProblem.of(CAMERA, PartSight(edges=edges))
    state = (pose.rotation, pose.translation_mm)
    across = np.abs(problem.residuals(state)) * edges.sigma_px
    shown = part_page().plots[4]
    assert isinstance(shown, ResidualField)
    lengths = np.linalg.norm(shown.errors_px[7:13], axis=1)
    np.testing.assert_allclose(lengths, across, atol=0.01)


def test_the_shares_of_a_located_part_add_up_to_its_covariance():
    pictures, eye = part_pictures()
    views = [p.view for p in pictures]
    both = np.sum(own_shares(views, eye), axis=0)
    np.testing.assert_allclose(both, locate(views, eye).own_covariance, rtol=1e-6)


def test_a_bar_far_beyond_the_others_is_marked():
    bars = ViewBars("x", "px", ("a", "b", "c"), np.array([1.0, 1.1, 9.0]))
    assert bars.outlying.tolist() == [False, False, True]


def test_an_eye_to_hand_scene_has_one_camera_and_a_target_for_every_pose():
    scene = next(
        p
        for p in hand_eye_page("eye-to-hand").plots
        if p.title.startswith("Where the c")
    )
    assert len(scene.cameras) == 1
    assert len(scene.outlines[0].lines_mm) == 12


def test_a_drawn_field_of_view_is_that_of_the_camera():
    scene = next(p for p in hand_eye_page().plots if p.title.startswith("Where the c"))
    shape = frustums(scene)[0]
    camera = scene.cameras[0]
    local = (shape - camera[:3, 3]) @ camera[:3, :3]
    pixels = Rehearsal().camera.fx_px * local[1:, :2] / local[1:, 2:]
    np.testing.assert_allclose(np.abs(pixels), [[800, 600]] * 4, rtol=1e-9)


@pytest.mark.parametrize(
    ("value", "sigma", "text", "spread"),
    [
        (2376.4123, 0.1234, "2376.41", "0.12"),
        (1347.0, 12.34, "1347", "12"),
        (-0.04947, 0.00123, "-0.0495", "0.0012"),
        (0.0, None, "0", "–"),
        (float("inf"), None, "infinite", "–"),
        (float("nan"), 1.0, "not known", "1.0"),
        (12.3456789, 0.0, "12.35", "0"),
    ],
)
def test_numbers_have_as_many_digits_as_their_sigma_allows(value, sigma, text, spread):
    assert value_text(value, sigma) == text
    assert sigma_text(sigma) == spread


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(OutputError, match="nowhere"):
        write_report(tmp_path / "nowhere", refused_report(
            "camera", CalibrationError("x"), About("camera")))  # fmt: skip
