"""Every bad input gives one clear message, the right exit code and no traceback."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from mvp.cell.loading import load_cell
from mvp.cell.places import bundled_root
from mvp.cli.main import invoke
from mvp.errors import CalibrationError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


@dataclass(frozen=True)
class Bad:
    """A spoilt cell and what the message must say.

    ``command`` may name {cell} and {out}; ``says`` are words of the message or hint.
    """

    name: str
    spoil: Callable[[Path], None]
    says: tuple[str, ...]
    command: str = "plan {cell}"
    code: int = 2


def edited(file: str, old: str, new: str) -> Callable[[Path], None]:
    def spoil(cell: Path) -> None:
        path = cell / file
        text = path.read_text()
        assert old in text, f"{old!r} is not in {file}"
        path.write_text(text.replace(old, new))

    return spoil


def cell_toml(old: str, new: str) -> Callable[[Path], None]:
    return edited("cell.toml", old, new)


def task_toml(old: str, new: str) -> Callable[[Path], None]:
    return edited("tasks/paper_object.toml", old, new)


def written(file: str, content: bytes) -> Callable[[Path], None]:
    def spoil(cell: Path) -> None:
        (cell / file).write_bytes(content)

    return spoil


def removed(file: str) -> Callable[[Path], None]:
    return lambda cell: (cell / file).unlink()


def calibration(name: str, change: Callable[[dict], None]) -> Callable[[Path], None]:
    def spoil(cell: Path) -> None:
        path = cell / "calibration" / f"{name}.json"
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))

    return spoil


def nothing(cell: Path) -> None:
    pass


def verdict(name: str, value: str) -> Callable[[Path], None]:
    def change(content: dict) -> None:
        content["quality"] |= {"verdict": value, "reasons": ["rms 3.1 px"]}

    return calibration(name, change)


STL = "parts/paper_object.stl"
EDGE = "from_mm = [-12.7, 0.0, 12.7]\nto_mm = [12.7, 0.0, 12.7]"

CASES = [
    Bad("no such cell", nothing, ("virtuall", "virtual"), "plan virtuall"),
    Bad("folder without cell.toml", removed("cell.toml"), ("cell.toml",)),
    Bad("no such task", nothing, ("nope", "paper_object"), "plan {cell} --task nope"),
    Bad("unknown option", nothing, ("--fast", "--help"), "plan {cell} --fast"),
    Bad("unknown command", nothing, ("fly",), "fly {cell}"),
    Bad("negative seed", nothing, ("--seed",), "plan {cell} --seed -4"),
    Bad("missing argument", nothing, ("CELL",), "plan"),
    Bad(
        "toml syntax",
        cell_toml('name = "virtual"', "name = virtual"),
        ("cell.toml:3:8",),
    ),
    Bad(
        "not utf-8", written("cell.toml", b"name = '\xff\xfe'"), ("cell.toml", "UTF-8")
    ),
    Bad("empty cell file", written("cell.toml", b""), ("schema_version", "missing")),
    Bad(
        "misspelt key",
        cell_toml("blur_circle_um", "blur_cirle_um"),
        ("cell.toml:", "optics.blur_cirle_um", 'did you mean "blur_circle_um"'),
    ),
    Bad(
        "misspelt table",
        cell_toml("[workspace]", "[workspaces]"),
        ("workspaces", 'did you mean "workspace"'),
    ),
    Bad("nan", cell_toml("blur_circle_um = 13.5", "blur_circle_um = nan"), ("finite",)),
    Bad(
        "infinite uncertainty",
        cell_toml("position_mm = 1.0", "position_mm = inf"),
        ("uncertainty.position_mm", "finite"),
    ),
    Bad(
        "negative blur",
        cell_toml("blur_circle_um = 13.5", "blur_circle_um = -1"),
        ("optics.blur_circle_um", "greater than 0", "-1"),
    ),
    Bad(
        "text for a number",
        cell_toml("radius_mm = ", 'radius_mm = "wide" # '),
        ("tool_bodies[0].radius_mm", "number", "wide"),
    ),
    Bad(
        "workspace inside out",
        cell_toml("low_mm = [", "low_mm = [9000, 0, 0] # ["),
        ("workspace", "on x", "9000"),
    ),
    Bad(
        "keep-out inside out",
        cell_toml(
            "[settle]",
            '[[keep_outs]]\nname = "wall"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, -1, 1]\n'
            "[settle]",
        ),
        ("keep_outs[0]", "wall", "on y"),
    ),
    Bad(
        "newer schema version",
        cell_toml("schema_version = 1", "schema_version = 7"),
        ("schema_version 7", "update"),
    ),
    Bad(
        "unknown arm model",
        cell_toml('model = "ur5e"', 'model = "ur5"'),
        ("kinematics.model", "ur5e"),
    ),
    Bad(
        "home of another arm",
        cell_toml("home_joints_deg = [", "home_joints_deg = [0, 0, 0] # ["),
        ("home_joints_deg", "6 values"),
    ),
    Bad(
        "unknown driver",
        cell_toml('driver = "virtual-arm"', 'driver = "virtual-am"'),
        ("arm.driver", "virtual-am", "virtual-arm"),
    ),
    Bad(
        "driver of another role",
        cell_toml('driver = "virtual-arm"', 'driver = "virtual-lens"'),
        ("arm.driver", "for the lens"),
    ),
    Bad(
        "driver's own key",
        cell_toml('driver = "virtual-lens"', 'driver = "virtual-lens"\nbuad = 9600'),
        ("lens.buad", "unknown key"),
    ),
    Bad(
        "world's own key",
        cell_toml('kind = "virtual"', 'kind = "virtual"\ngravity = 9.81'),
        ("world.gravity", "unknown key"),
    ),
    Bad(
        "unknown world",
        cell_toml('kind = "virtual"', 'kind = "flat"'),
        ("world.kind", "flat"),
    ),
    Bad(
        "world of a real cell",
        cell_toml("simulated = true", "simulated = false"),
        ("world", "simulated is false"),
    ),
    Bad(
        "task outside of the cell",
        cell_toml('"tasks/paper_object.toml"', '"../../etc/passwd"'),
        ("outside",),
    ),
    Bad(
        "part outside of the cell",
        task_toml("../parts/paper_object.stl", "/etc/passwd"),
        ("part.file", "outside", "paper_object.toml:"),
    ),
    Bad("missing part", removed(STL), ("part.file", "paper_object.stl", "not exist")),
    Bad("missing task", removed("tasks/paper_object.toml"), ("paper_object.toml",)),
    Bad("wrong unit", task_toml('units = "mm"', 'units = "furlong"'), ("part.units",)),
    Bad("no feature", task_toml("[[features]]", "[[feature]]"), ("feature",)),
    Bad(
        "two features of one name",
        task_toml('id = "vertical edge"', 'id = "horizontal edge"'),
        ("horizontal edge", "two features", "features[1].id", "the other one is at"),
    ),
    Bad(
        "unknown kind",
        task_toml('kind = "edge"', 'kind = "egde"'),
        ("features[0].kind", "not 'egde'; did you mean 'edge'?", "paper_object.toml:"),
    ),
    Bad(
        "zero-length edge",
        task_toml(EDGE, EDGE.replace("[-12.7, 0.0, 12.7]", "[12.7, 0.0, 12.7]")),
        ("horizontal edge", "no length"),
    ),
    Bad(
        "feature inside the solid",
        task_toml(EDGE, "from_mm = [-5, 12, 0]\nto_mm = [5, 12, 0]"),
        ("horizontal edge", "inside"),
    ),
    Bad(
        "two features off the part",
        task_toml("12.7]", "500]"),
        ("horizontal edge", "vertical edge"),
    ),
    Bad(
        "lens table that turns back",
        calibration(
            "lens_table", lambda c: c["zoom_f_mm"]["values_mm"].__setitem__(0, 14.0)
        ),
        ("lens_table.json", "rise or fall"),
    ),
    Bad(
        "feature off the part",
        task_toml(EDGE, "from_mm = [500, 0, 0]\nto_mm = [520, 0, 0]"),
        ("horizontal edge", "paper_object.toml:"),
    ),
    Bad(
        "unknown reference",
        task_toml(
            f'kind = "edge"\n{EDGE}',
            'ref = "E999"',
        ),
        ("E999", "features"),
    ),
    Bad(
        "nan in a feature",
        task_toml("from_mm = [-12.7, 0.0, 12.7]", "from_mm = [nan, 0.0, 12.7]"),
        ("features[0].from_mm[0]", "finite"),
    ),
    Bad(
        "contradictory lens range",
        task_toml("f_mm = 12.5", "f_mm = [14, 12]"),
        ("lens.f_mm", "above the upper bound"),
    ),
    Bad(
        "negative pixels",
        task_toml("pixels = 1.0", "pixels = -1"),
        ("resolution.pixels",),
    ),
    Bad("empty mesh", written(STL, b"solid x\nendsolid x\n"), ("paper_object.stl",)),
    Bad("not a mesh", written(STL, b"hello, world\n"), ("paper_object.stl",)),
    Bad("truncated mesh", written(STL, b"\0" * 80 + b"\x60\0\0\0abc"), ("stl",)),
    Bad(
        "missing calibration",
        removed("calibration/hand_eye.json"),
        ("hand_eye", "[calibration]"),
    ),
    Bad(
        "damaged calibration",
        written("calibration/camera.json", b"{"),
        ("camera.json", "[calibration]"),
    ),
    Bad(
        "swapped calibrations",
        cell_toml("calibration/hand_eye.json", "calibration/part_pose.json"),
        ("part_pose.json", "camera to tool"),
    ),
    Bad("poor calibration", verdict("lens_table", "no-go"), ("NO-GO", "rms 3.1 px")),
    Bad("marginal calibration", verdict("camera", "marginal"), ("MARGINAL",)),
    Bad(
        "hand-eye that is no rotation",
        calibration("hand_eye", lambda c: c["matrix"][0].__setitem__(0, 2.0)),
        ("hand_eye.json", "not a rotation"),
    ),
    Bad(
        "calibration of another camera",
        calibration(
            "camera", lambda c: c["provenance"].__setitem__("device_serial", "X-9")
        ),
        ("X-9", "camera.json"),
        "run {cell} --out {out}",
    ),
    Bad(
        "unknown driver, asked by check",
        cell_toml('driver = "virtual-arm"', 'driver = "virtual-am"'),
        ("cell.toml:", "arm.driver", "did you mean 'virtual-arm'"),
        "check {cell}",
    ),
    Bad(
        "resume of nothing",
        nothing,
        ("20250101", "runs"),
        "run {cell} --resume 20250101 --out {out}",
    ),
    Bad("step without terminal", nothing, ("--step",), "run {cell} --step --out {out}"),
    Bad("report of nothing", nothing, ("nope",), "report nope --out {out}"),
    Bad("init into a full folder", nothing, ("not an empty",), "init {cell}"),
    Bad("init of nothing", nothing, ("mars", "virtual"), "init {out}/x --from mars"),
    Bad(
        "unwritable folder",
        written("file", b"x"),
        ("file",),
        "run {cell} --out {cell}/file/runs",
    ),
    Bad(
        "unwritable figures",
        written("file", b"x"),
        ("file",),
        "plan {cell} --figures {cell}/file/figures",
    ),
    Bad(
        "folder for a plan",
        nothing,
        ("is a folder",),
        "plan {cell} --out {cell}",
    ),
    Bad(
        "unwritable plan",
        written("file", b"x"),
        ("file",),
        "plan {cell} --out {cell}/file/plan.json",
    ),
]


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    folder = tmp_path / "cell"
    shutil.copytree(bundled_root() / "virtual", folder, copy_function=shutil.copyfile)
    return folder


def too_late(*arguments: object, **options: object) -> None:
    raise RuntimeError("planned before the outputs were checked")


@pytest.mark.parametrize("bad", CASES, ids=lambda bad: bad.name)
def test_bad_input_is_named_with_the_right_exit_code(
    bad: Bad,
    cell: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bad.spoil(cell)
    if bad.name.startswith(("unwritable", "folder")):
        # In this order: the first one imports a module that takes it from the second.
        monkeypatch.setattr("mvp.cli.run_flow.make_plan", too_late)
        monkeypatch.setattr("mvp.cell.plan_job.make_plan", too_late)
    out = tmp_path / "out"
    words = [w.format(cell=cell, out=out) for w in bad.command.split()]
    before = sorted(p for p in tmp_path.rglob("*"))
    code = invoke([*words, "--json"])
    said = capsys.readouterr()
    document = json.loads(said.out)
    text = " ".join((document["message"], document["hint"], document["where"]))
    assert code == bad.code == document["code"]
    assert document["schema"] == "mvp-cell/error/1"
    for word in bad.says:
        assert word in text
    assert document["message"].splitlines()[0] in said.err
    assert "Traceback" not in said.err
    assert "bug" not in text
    after = list(tmp_path.rglob("*"))
    assert sorted(after) in (before, sorted([*before, out]))


def test_there_are_at_least_forty_bad_inputs() -> None:
    assert len(CASES) >= 40


def test_a_poor_calibration_can_be_accepted_with_a_reason(cell: Path) -> None:
    verdict("camera", "marginal")(cell)
    with pytest.raises(CalibrationError):
        load_cell(str(cell))
    loaded = load_cell(str(cell), accept_calibration="first light")
    assert loaded.calibrations.accepted == {"camera": "first light"}
