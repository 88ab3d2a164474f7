"""Units for systemd as the pages show them."""

import re
from pathlib import Path

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to"


def unit_of(page: str, **changed: str) -> str:
    """Return the unit that a page shows, with other values for some of its keys."""
    found = re.search(r"^```text\n(\[Unit\].*?)^```", (HOW_TO / page).read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert found is not None, f"{page} shows no unit"
    unit = found[1]
    for key, value in changed.items():
        unit, count = re.subn(rf"^{key}=.*$", f"{key}={value}", unit, flags=re.MULTILINE)
        assert count == 1, f"the unit of {page} has {key} {count} times"
    return unit
