"""MkDocs hook: pages and files from outside the docs folder, with their links adjusted.

A link in a Markdown file is relative to the file, so that it works on a code host. The site has
another layout: the docs folder is its root and README.md its index. This hook rewrites each
relative link, and adds the linked files to the site. MkDocs then reports the dead links.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "bench/README.md"]
#: In an annotation: what `_core_stubs.reads.Reads` returns instead of an answer, never of a tree.
NO_ANSWER = re.compile(
    r""" <span class="o">\|</span> <span class="n">N</span>| \| <span title="[\w.]*\.N">N</span>"""
)
LINK = re.compile(r"\[(?P<text>[^\[\]]*)\]\((?P<path>[^)#\s:]+)(?P<anchor>#[^)]*)?\)")


def site_path(path: str) -> str:
    """The place in the site of a file of the repository."""
    return "index.md" if path == "README.md" else path.removeprefix("docs/")


def repository_path(uri: str) -> str:
    """The inverse of `site_path`."""
    if uri == "index.md":
        return "README.md"
    return uri if uri in OUTSIDE else f"docs/{uri}"


def link_target(page: str, link: str) -> str:
    """The file of the repository that a link leads to; a folder stands for its README.md."""
    path = posixpath.normpath(posixpath.join(posixpath.dirname(page), link))
    return f"{path}/README.md" if (ROOT / path).is_dir() else path


def on_files(files: Files, config: Any) -> Files:
    for path in OUTSIDE:
        files.append(File.generated(config, site_path(path), content=(ROOT / path).read_text()))
    for file in list(files.documentation_pages()):
        page = repository_path(file.src_uri)
        for match in LINK.finditer(file.content_string):
            path = link_target(page, match["path"])
            uri = site_path(path)
            if files.get_file_from_path(uri) is None and (ROOT / path).is_file():
                files.append(File.generated(config, uri, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    source = repository_path(page.file.src_uri)
    folder = posixpath.dirname(page.file.src_uri)

    def rewrite(match: re.Match[str]) -> str:
        path = link_target(source, match["path"])
        if path.endswith("/README.md") and not (ROOT / path).exists():
            return match["text"]  # a folder without a page
        link = posixpath.relpath(site_path(path), folder or ".")
        return f"[{match['text']}]({link}{match['anchor'] or ''})"

    return LINK.sub(rewrite, markdown)


def on_post_page(output: str, page: Any, config: Any) -> str:
    """Refuses pages that would load something from the network, and names no `NO_ANSWER`."""
    for tag in re.findall(r"<(?:script|link|img|iframe)\b[^>]*", output):
        if re.search(r"""(?:src|href)=["']?(?:https?:)?//""", tag) and "canonical" not in tag:
            raise PluginError(f"{page.file.src_uri} loads from the network: {tag}>")
    return NO_ANSWER.sub("", output)
