"""Every code block in the documentation does what it says."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(ROOT.glob("docs/**/*.md")),
]
BLOCK = re.compile(r"^```([a-z]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
RUNNABLE = {"python", "bash"}
READABLE = {"toml", "json"}
PLAIN = {"text", "mermaid", ""}


def blocks(page: Path, language: str) -> list[str]:
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [body for tag, body in found if tag == language]


def pages_with(language: str) -> list[Path]:
    return [page for page in PAGES if page.exists() and blocks(page, language)]


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def expect_success(command: list[str], folder: Path) -> None:
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "NO_COLOR": "1",
    }
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=500,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_every_block_is_of_a_kind_that_is_checked() -> None:
    for page in (page for page in PAGES if page.exists()):
        tags = {tag for tag, _ in BLOCK.findall(page.read_text(encoding="utf-8"))}
        assert tags <= RUNNABLE | READABLE | PLAIN, f"{name(page)}: {tags}"


@pytest.mark.parametrize("page", pages_with("python"), ids=name)
def test_the_python_of_a_page_runs_from_top_to_bottom(
    page: Path, tmp_path: Path
) -> None:
    script = tmp_path / "page.py"
    script.write_text("\n".join(blocks(page, "python")), encoding="utf-8")
    expect_success([sys.executable, "-W", "error", str(script)], tmp_path)


@pytest.mark.parametrize("page", pages_with("bash"), ids=name)
def test_the_commands_of_a_page_run_in_an_empty_folder(
    page: Path, tmp_path: Path
) -> None:
    lines = "\n".join(blocks(page, "bash"))
    # `make` targets are what runs these tests: here they are only resolved.
    lines = re.sub(r"^make ", f"make -n -C {ROOT} ", lines, flags=re.MULTILINE)
    expect_success(["bash", "-euo", "pipefail", "-c", lines], tmp_path)


@pytest.mark.parametrize("page", pages_with("toml"), ids=name)
def test_the_toml_of_a_page_parses(page: Path) -> None:
    for body in blocks(page, "toml"):
        assert tomllib.loads(body)


def test_all_json_in_the_documentation_parses() -> None:
    for page in PAGES:
        for body in blocks(page, "json"):
            assert json.loads(body) is not None, name(page)


def test_every_link_inside_the_documentation_leads_somewhere() -> None:
    link = re.compile(r"\]\((?!https?:|#|mailto:)([^)#]+)(?:#[^)]*)?\)")
    for page in (page for page in PAGES if page.exists()):
        for target in link.findall(page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{name(page)}: {target}"
