"""The list of frames in the panel: search, check-boxes, pages."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, Final

import viser

from zenoh_tf.text import cut, printable
from zenoh_tf_tools.viewer.controls import frame_tree
from zenoh_tf_tools.viewer.source import ViewedLink

#: Lines of a page: a check-box costs the browser more than a frame in the scene.
_PAGE: Final = 20
_CHARS: Final = 40
_SHOW: Final = "show"
_HIDE: Final = "hide"
_ONLY: Final = "only these"
#: viser gives the name of a check-box a third of the line, left of the box. Those of the list get
#: the rest of the line, right of it: they are the only check-boxes without a hint.
_LINE: Final = ".mantine-Flex-root:has(>div>.mantine-Checkbox-root)"
_STYLE: Final = (
    f"<style>{_LINE}{{flex-direction:row-reverse}}"
    f"{_LINE}>div{{flex-grow:0!important;padding-right:0.6em}}"
    f"{_LINE}>div:first-child{{width:auto!important;flex-grow:1!important;min-width:0;"
    "flex-shrink:1!important;white-space:nowrap;overflow:hidden}"
    f"div:has(>{_LINE}){{padding-bottom:0.15em!important}}</style>"
)


class FrameList:
    """Which frames a person wants to see. The viewer's thread calls its methods."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Make the controls."""
        self.unchecked: set[str] = set()
        self._clicked = deque[str](maxlen=8)
        self._turned = deque[int](maxlen=8)
        self._page = 0
        self._shown: list[tuple[str, bool]] = []  # frame and mark of each line
        gui.add_html(_STYLE)
        self.search: Any = gui.add_text("search", "", hint="a part of the frames' names")
        marks = gui.add_button_group("all found", (_SHOW, _HIDE, _ONLY))
        marks.on_click(lambda event: self._clicked.append(event.target.value))
        self._lines: list[Any] = [gui.add_checkbox("", True, visible=False) for _ in range(_PAGE)]
        self._pages: Any = gui.add_button_group("page", ("◀", "▶"), visible=False)
        self._pages.on_click(
            lambda event: self._turned.append(1 if event.target.value == "▶" else -1)
        )
        self._count: Any = gui.add_html("")

    def update(self, links: Mapping[str, ViewedLink]) -> None:
        """Read what a person has done, and show the frames there are."""
        for (name, mark), line in zip(self._shown, self._lines, strict=False):
            if line.value != mark:
                self._mark(frame_tree.with_descendants(links, name), line.value)
        listed = frame_tree.rows(links, self.search.value)
        found = {row.name for row in listed if row.found}
        while self._clicked:
            self._mark_all(self._clicked.popleft(), links, found)
        while self._turned:
            self._page += self._turned.popleft()
        self.unchecked &= links.keys()
        self._page, rows = frame_tree.page_of(listed, self._page, _PAGE)
        self._show(rows)
        pages = (len(listed) - 1) // _PAGE + 1
        if self._pages.visible != (pages > 1):
            self._pages.visible = pages > 1
        count = f"{len(found):,} of {len(links):,} frames"
        page = f", page {self._page + 1} of {pages}" if pages > 1 else ""
        hidden = f", {len(self.unchecked):,} hidden" if self.unchecked else ""
        content = f"<div style='font-size:0.85em;padding:0.2em 1em'>{count}{page}{hidden}</div>"
        if self._count.content != content:
            self._count.content = content

    def _mark_all(self, what: str, links: Mapping[str, ViewedLink], found: set[str]) -> None:
        if what == _ONLY:
            self.unchecked = links.keys() - found
        else:
            self._mark(found, what == _SHOW)

    def _mark(self, names: set[str], shown: bool) -> None:
        if shown:
            self.unchecked -= names
        else:
            self.unchecked |= names

    def _show(self, rows: Any) -> None:
        """Show these lines, and send what has changed."""
        self._shown = [(row.name, row.name not in self.unchecked) for row in rows]
        for number, line in enumerate(self._lines):
            visible = number < len(rows)
            if visible:
                row, (_, mark) = rows[number], self._shown[number]
                # Spaces that HTML keeps.
                label = "\u00a0" * (3 * min(row.depth, 8)) + cut(printable(row.name), _CHARS)
                if line.label != label:
                    line.label = label
                if line.value != mark:
                    line.value = mark
            if line.visible != visible:
                line.visible = visible
