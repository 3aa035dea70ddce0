"""What tests see of a page."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from sympol.trees import DecisionTree


@dataclass
class Tab:
    """A page in the browser, and everything it complained of."""

    page: Any
    complaints: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def open(self, path: Path) -> Any:
        self.page.goto(path.as_uri())
        return self.page


def written(tree: DecisionTree, folder: Path) -> Path:
    path = folder / "tree.html"
    path.write_text(tree.to_html(), encoding="utf-8")
    return path


def lit(page: Any) -> list[int]:
    return page.eval_on_selector_all(
        "[role=treeitem].lit", "items => items.map((item) => Number(item.dataset.node))"
    )


def shown(page: Any) -> int:
    return page.locator("[role=treeitem]").count()


def pixels(locator: Any) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(locator.screenshot())).convert("RGB")).astype(int)


def near(picture: np.ndarray, colour: tuple[int, ...]) -> int:
    """How many pixels have a colour."""
    return int((np.abs(picture - np.array(colour)).max(axis=2) <= 6).sum())


def leaves_in(page: Any, x: np.ndarray) -> list[int]:
    """The leaves of float64 observations, asked of the page's own program."""
    text = base64.b64encode(x.astype("<f8").tobytes()).decode()
    return page.evaluate(
        """([text, columns]) => {
          const numbers = new Float64Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
          const leaves = [];
          for (let i = 0; i < numbers.length; i += columns)
            leaves.push(sympol.leafOf(numbers.subarray(i, i + columns)));
          return leaves;
        }""",
        [text, x.shape[1]],
    )
