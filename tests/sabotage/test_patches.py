"""Every planted bug still applies to the tree (`make sabotage` plants them, which takes longer)."""

import subprocess
from pathlib import Path

import pytest

from sabotage import HERE, ROOT, read_sabotage

PATCHES = sorted(HERE.glob("*.patch"))


@pytest.mark.parametrize("patch", PATCHES, ids=lambda patch: patch.stem)
def test_patch_applies(patch: Path) -> None:
    assert read_sabotage(patch).what
    subprocess.run(["git", "apply", "--check", str(patch)], cwd=ROOT, check=True)
