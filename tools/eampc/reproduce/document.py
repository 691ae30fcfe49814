"""A page of headings, paragraphs, lists, tables and pictures, as Markdown and as one HTML file."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eampc.hil.report import STYLE
from eampc.reproduce.paper_tables import Table

_FIGURES = """
figure { margin: 1.2rem 0; }
figcaption { color: #444; }
td { white-space: nowrap; }
.columns { overflow-x: auto; }
"""


@dataclass(frozen=True)
class Heading:
    text: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    text: str


@dataclass(frozen=True)
class Points:
    items: tuple[str, ...]


@dataclass(frozen=True)
class Picture:
    path: Path
    caption: str


Block = Heading | Paragraph | Points | Table | Picture


def as_markdown(title: str, blocks: Sequence[Block], folder: Path) -> str:
    """Pictures are referred to, from a file in `folder`."""
    parts = [f"# {title}"]
    for block in blocks:
        match block:
            case Heading(text, level):
                parts.append(f"{'#' * level} {text}")
            case Paragraph(text):
                parts.append(text)
            case Points(items):
                parts.append("\n".join(f"- {item}" for item in items))
            case Table():
                parts.append(_markdown_table(block))
            case Picture(path, caption):
                target = path.relative_to(folder).as_posix()
                parts.append(f"![{caption}]({target})\n\n*{caption}*")
    return "\n\n".join(parts) + "\n"


def as_html(title: str, blocks: Sequence[Block]) -> str:
    """One file that needs no other: style and pictures are in it."""
    parts = [f"<h1>{html.escape(title)}</h1>"]
    for block in blocks:
        match block:
            case Heading(text, level):
                parts.append(f"<h{level}>{html.escape(text)}</h{level}>")
            case Paragraph(text):
                parts.append(f"<p>{html.escape(text)}</p>")
            case Points(items):
                listed = "\n".join(f"<li>{html.escape(item)}</li>" for item in items)
                parts.append(f"<ul>\n{listed}\n</ul>")
            case Table():
                parts.append(_html_table(block))
            case Picture(path, caption):
                data = base64.b64encode(path.read_bytes()).decode("ascii")
                parts.append(
                    f'<figure><img alt="{html.escape(caption)}" src="data:image/png;base64,{data}">'
                    f"<figcaption>{html.escape(caption)}</figcaption></figure>"
                )
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{html.escape(title)}</title>\n<style>{STYLE}{_FIGURES}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )


def _markdown_table(table: Table) -> str:
    rows = [table.heading, ("---", *["---:"] * (len(table.heading) - 1)), *table.rows]
    # A bar would end the cell.
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return f"**{table.title}**\n\n" + "\n".join(lines)


def _html_table(table: Table) -> str:
    def line(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    rows = "\n".join([line(table.heading, "th"), *(line(row, "td") for row in table.rows)])
    return (
        f'<div class="columns"><p><strong>{html.escape(table.title)}</strong></p>\n'
        f"<table>\n{rows}\n</table></div>"
    )
