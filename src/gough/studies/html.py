"""A report as one HTML page without any outside address."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from importlib import resources

from gough.studies import numbers
from gough.studies.report import (
    Block,
    Cell,
    Command,
    Paragraph,
    Picture,
    Points,
    Section,
    Table,
)

EMPTY = ("meta", "img", "br")
"""Elements that have no end."""
LONG = 12
"""Rows beyond which a table may be split between printed pages."""


def page(title: str, about: str, sections: Sequence[Section]) -> str:
    """The whole page: title, table of contents, sections with numbered figures and tables."""
    style = (resources.files("gough.studies") / "page.css").read_text(encoding="utf-8")
    head = (
        element("meta", charset="utf-8")
        + element("meta", name="viewport", content="width=device-width, initial-scale=1")
        + element("title", text(title))
        + element("style", style)
    )
    opening = element("h1", text(title)) + (
        element("p", text(about), class_="about") if about else ""
    )
    counts = {"Figure": 0, "Table": 0}
    body = [element("header", opening), _contents(sections)]
    body += [_section(section, counts) for section in sections]
    main = element("main", "".join(body))
    return "<!DOCTYPE html>\n" + element(
        "html", element("head", head) + element("body", main), lang="en"
    )


def element(tag: str, inner: str = "", **attributes: str) -> str:
    """An element with its inner HTML; a name of an attribute may end in ``_`` to pass Python."""
    named = {name.rstrip("_").replace("_", "-"): value for name, value in attributes.items()}
    written = "".join(f' {name}="{html.escape(value)}"' for name, value in named.items())
    return f"<{tag}{written}>" if tag in EMPTY else f"<{tag}{written}>{inner}</{tag}>\n"


def text(plain: str) -> str:
    """Plain text as HTML."""
    return html.escape(plain, quote=False)


def _contents(sections: Iterable[Section]) -> str:
    links = (
        element("li", element("a", text(section.title), href=f"#{section.name}"))
        for section in sections
    )
    return element("nav", element("ol", "".join(links)), aria_label="Contents")


def _section(section: Section, counts: dict[str, int]) -> str:
    inner = element("h2", text(section.title))
    inner += "".join(_block(block, counts) for block in section.blocks)
    return element("section", inner, id=section.name)


def _block(block: Block, counts: dict[str, int]) -> str:
    match block:
        case Paragraph():
            return element("p", text(block.text))
        case Points():
            return element("ul", "".join(element("li", text(item)) for item in block.items))
        case Command():
            return element("pre", element("code", text(block.text)).strip())
        case Table():
            return _table(block, counts)
        case Picture():
            return _picture(block, counts)


def _numbered(kind: str, caption: str, counts: dict[str, int]) -> str:
    counts[kind] += 1
    return element("b", text(f"{kind} {counts[kind]}.")).strip() + " " + text(caption)


def _picture(picture: Picture, counts: dict[str, int]) -> str:
    packed = base64.b64encode(picture.svg).decode("ascii")
    image = element("img", alt=picture.about, src=f"data:image/svg+xml;base64,{packed}")
    caption = element("figcaption", _numbered("Figure", picture.caption, counts))
    return element("figure", image + caption, id=f"figure-{picture.name}")


def _table(table: Table, counts: dict[str, int]) -> str:
    numeric = [_is_numeric(row[k] for row in table.rows) for k in range(len(table.columns))]
    caption, inner = "", ""
    if table.caption:
        caption = element("figcaption", _numbered("Table", table.caption, counts))
    if any(table.columns):
        cells = (
            _cell("th", text(name), number, scope="col")
            for name, number in zip(table.columns, numeric, strict=True)
        )
        inner += element("thead", element("tr", "".join(cells)))
    rows = (_row(row, numeric) for row in table.rows)
    inner += element("tbody", "".join(rows))
    kind = "listing" if any(table.columns) else "facts"
    around = "table" if len(table.rows) <= LONG else "table long"
    return element("figure", caption + element("table", inner, class_=kind), class_=around)


def _row(row: Sequence[Cell], numeric: Sequence[bool]) -> str:
    first = element("th", text(written(row[0])), scope="row").strip()
    others = (
        _cell("td", text(written(cell)), number)
        for cell, number in zip(row[1:], numeric[1:], strict=True)
    )
    return element("tr", first + "".join(others))


def _cell(tag: str, inner: str, number: bool, **attributes: str) -> str:
    if number:
        attributes["class_"] = "number"
    return element(tag, inner, **attributes).strip()


def _is_numeric(cells: Iterable[Cell]) -> bool:
    """Whether a column holds numbers only, gaps aside."""
    present = [cell for cell in cells if cell is not None and cell != ""]
    return bool(present) and all(
        isinstance(cell, int | float) and not isinstance(cell, bool) for cell in present
    )


def written(cell: Cell) -> str:
    """A cell as text: six digits, yes or no, nothing for None."""
    match cell:
        case None:
            return ""
        case bool():
            return "yes" if cell else "no"
        case int():
            return numbers.written(cell, 20)
        case float():
            return numbers.written(cell)
    return cell
