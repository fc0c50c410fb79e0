"""The README as a package index shows it: without the pictures and pages of the repository."""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PICTURE = re.compile(r"^!\[[^]]*\]\([^)]*\)\n\n?", re.MULTILINE)
PAGE = re.compile(r"\[([^]]*)\]\((?!https?://)[^)]*\)")


class Readme(MetadataHookInterface):
    """Hook of hatchling, which finds it by its base."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Give the metadata their description."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = PAGE.sub(r"\1", PICTURE.sub("", text))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
