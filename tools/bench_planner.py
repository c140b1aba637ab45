"""All timings of the planner in one table, each beside its rival in the same run.

Usage: python tools/bench_planner.py [--quick] [--markdown FILE]

Rivals are plain ways to the same result on the same machine at the same time: one hull
per triangle and one union, generate-and-test with the same vectorised rows, Embree
called directly, one ray per pixel. Targets are bars for a quiet machine; nothing fails
where one is missed, the table says so.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(threads, "1")

from tools import bench_regions, bench_render, bench_search, bench_verify  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

LIBRARIES = ("numpy", "scipy", "embreex", "manifold3d", "libigl", "highspy")
COMMAND = (
    "import sys; sys.argv[0] = 'mvp-cell'; from mvp.cli.main import main; "
    "sys.exit(main())"
)
# What the system keeps for a finished child begins with the size of its parent.
PEAK = (
    "import atexit, pathlib; atexit.register(lambda: pathlib.Path('peak').write_text("
    "pathlib.Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0])); "
)
HEAVY = ("cv2", "scipy", "trimesh", "igl", "matplotlib", "embreex", "manifold3d")
PLAN_BAR_S, PLAN_BAR_MB = 60.0, 4000.0
FASTER_REGION, FASTER_SEARCH, FASTER_SIGHT, FASTER_FRAME = 1.0, 50.0, 0.5, 0.2


@dataclass(frozen=True)
class Line:
    """One line of the table.

    Attributes:
        what: what was timed. ``note``: sizes and counts.
        ours: our figure with its unit. ``rival``: the rival's.
        ratio: how many times as fast as the rival; None without one.
        target: the bar in words; empty where there is none.
        met: whether it was met; None where there is none.
    """

    what: str
    ours: str
    rival: str = ""
    ratio: float | None = None
    target: str = ""
    met: bool | None = None
    note: str = ""

    @property
    def cells(self) -> tuple[str, ...]:
        """As printed."""
        ratio = "" if self.ratio is None else f"{self.ratio:.3g} x"
        met = {True: "yes", False: "NO", None: ""}[self.met]
        return (self.what, self.ours, self.rival, ratio, self.target, met, self.note)


HEADER = ("what", "ours", "rival", "as fast as it", "target", "met", "note")


def _beside(
    what: str, ours_s: float, rival_s: float, least: float | None, note: str = ""
) -> Line:
    """A line against a rival; ``least`` is how many times as fast we must be."""
    ratio = rival_s / ours_s
    target = "" if least is None else f">= {least:g} x"
    met = None if least is None else ratio >= least
    return Line(what, _seconds(ours_s), _seconds(rival_s), ratio, target, met, note)


def _alone(what: str, ours_s: float, most_s: float | None, note: str = "") -> Line:
    """A line without a rival."""
    target = "" if most_s is None else f"<= {most_s:g} s"
    met = None if most_s is None else ours_s <= most_s
    return Line(what, _seconds(ours_s), "", None, target, met, note)


def _seconds(value: float) -> str:
    return f"{1e3 * value:.3g} ms" if value < 0.1 else f"{value:.3g} s"


def regions(quick: bool) -> Iterator[Line]:
    """Visibility regions and lines of sight."""
    for row in bench_regions.run(quick):
        if row.rival_s is None:
            yield _alone(row.name, row.ours_s, row.target, row.note)
        else:
            least = FASTER_SIGHT if row.name == "line of sight" else FASTER_REGION
            yield _beside(row.name, row.ours_s, row.rival_s, least, row.note)


def search(quick: bool) -> Iterator[Line]:
    """The search against generate-and-test, the plan, the certificate."""
    for row in bench_search.run(quick):
        if row.rival_s is None:
            yield _alone(row.what, row.ours_s, row.most_s, row.note)
        else:
            # A quick run does not give the rival the time to lose by the full factor.
            least = None if quick and row.given_up else FASTER_SEARCH
            yield _beside(row.what, row.ours_s, row.rival_s, least, row.note)


def pictures(quick: bool) -> Iterator[Line]:
    """Virtual frames against one ray per pixel."""
    for row in bench_render.run(quick=quick):
        what = f"frame of view {row.view}, {row.setting}"
        yield _beside(what, row.frame_s, row.plain_s, FASTER_FRAME, "1 ray per pixel")


def verification(quick: bool) -> Iterator[Line]:
    """Verification of a picture."""
    for row in bench_verify.run(quick=quick):
        yield _alone(row.name, row.seconds, row.target)


def commands(quick: bool) -> Iterator[Line]:
    """Whole commands, each in a fresh process."""
    times = [_command("--help").seconds for _ in range(3 if quick else 9)]
    yield _alone("mvp-cell --help", sorted(times)[len(times) // 2], None)
    found = _imported_by_help()
    yield Line(
        "mvp-cell --help imports",
        ", ".join(found) or "nothing heavy",
        target="neither cv2 nor scipy",
        met=not {"cv2", "scipy"} & set(found),
    )
    plain = _command("plan", "virtual", "--json")
    yield _alone("mvp-cell plan virtual", plain.seconds, None, plain.note)
    nist = _command("plan", "virtual", "--task", "nist_ctc_01", "--json")
    yield _alone("mvp-cell plan, NIST CTC-01", nist.seconds, PLAN_BAR_S, nist.note)
    yield Line(
        "mvp-cell plan, NIST CTC-01, peak memory",
        f"{nist.megabytes:.0f} MB",
        target=f"<= {PLAN_BAR_MB:.0f} MB",
        met=nist.megabytes <= PLAN_BAR_MB,
    )


@dataclass(frozen=True)
class Spent:
    """Seconds on the clock, seconds of processor, peak memory in MB."""

    seconds: float
    cpu_s: float
    megabytes: float

    @property
    def note(self) -> str:
        """In words."""
        return f"{self.cpu_s:.2g} s of processor, {self.megabytes:.0f} MB at most"


def _command(*arguments: str) -> Spent:
    """What one command takes.

    Raises:
        RuntimeError: it failed.
    """
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as said:
        start = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-c", PEAK + COMMAND, *arguments],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=said,
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            said.seek(0)
            raise RuntimeError(f"{arguments} failed: {said.read().decode()[-2000:]}")
        megabytes = float((Path(folder) / "peak").read_text(encoding="utf-8")) / 1024
    return Spent(seconds, usage.ru_utime + usage.ru_stime, megabytes)


def _imported_by_help() -> list[str]:
    """Heavy libraries that --help loads."""
    script = (
        "import atexit, sys; "
        f"atexit.register(lambda: print(*[m for m in {HEAVY} if m in sys.modules], "
        f"file=sys.stderr)); {COMMAND}"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, "--help"],
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stderr.split()


SECTIONS: dict[str, Callable[[bool], Iterator[Line]]] = {
    "Regions and lines of sight": regions,
    "Search": search,
    "Virtual pictures": pictures,
    "Verification": verification,
    "Commands": commands,
}


def machine() -> list[str]:
    """What the figures were measured on."""
    model = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    except OSError:
        pass
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return [
        f"{os.cpu_count()} cores, {model}{load}; one thread",
        f"{platform.platform()}, Python {platform.python_version()}, {libraries}",
        f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
    ]


def as_text(title: str, lines: list[Line]) -> str:
    """A section for the terminal."""
    rows = [HEADER, *(line.cells for line in lines)]
    width = [max(len(row[i]) for row in rows) for i in range(len(HEADER) - 1)]
    printed = [
        "  ".join([*(f"{c:<{w}}" for c, w in zip(row, width, strict=False)), row[-1]])
        for row in rows
    ]
    return "\n".join([f"\n{title}", *(line.rstrip() for line in printed)])


def as_markdown(title: str, lines: list[Line]) -> str:
    """A section for the docs."""
    rows = [HEADER, ("---",) * len(HEADER), *(line.cells for line in lines)]
    table = [
        f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows
    ]
    return "\n".join([f"\n## {title}\n", *table])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repeats")
    parser.add_argument("--markdown", type=Path, help="write the tables there as well")
    parser.add_argument(
        "--only", choices=[name.split()[0].lower() for name in SECTIONS]
    )
    arguments = parser.parse_args()
    facts = machine()
    print(*facts, sep="\n")
    pages, missed = ["# Measured speed", "", *(f"- {fact}" for fact in facts)], []
    for title, section in SECTIONS.items():
        if arguments.only not in (None, title.split()[0].lower()):
            continue
        lines = list(section(arguments.quick))
        missed += [line.what for line in lines if line.met is False]
        print(as_text(title, lines), flush=True)
        pages.append(as_markdown(title, lines))
    print(f"\ntargets missed: {', '.join(missed) or 'none'}")
    if arguments.markdown is not None:
        arguments.markdown.write_text("\n".join(pages) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
