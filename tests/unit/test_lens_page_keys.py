import re
import tomllib
from pathlib import Path

import pytest

from mvp.devices import load_driver

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "connect-a-serial-lens.md"
BLOCKS = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS)
def test_the_keys_of_the_page_are_those_of_the_driver(block: str) -> None:
    keys = tomllib.loads(block)["lens"]
    driver = load_driver(keys.pop("driver"), "lens")
    config = driver.Config.model_validate(keys)
    assert keys.keys() <= config.model_fields_set


def test_the_page_shows_every_serial_lens() -> None:
    shown = {tomllib.loads(block)["lens"]["driver"] for block in BLOCKS}
    assert shown == {"scf4", "theia-mcr", "visca"}
