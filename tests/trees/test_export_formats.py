"""The table of formats is all that the rest of the library and its documentation know about exports."""

from __future__ import annotations

from pathlib import Path

import pytest

from sympol.trees.export import FORMATS, SUFFIXES, Format, format_of

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "exports.md"
BEGIN, END = "<!-- from FORMATS, by pytest --update-golden -->\n\n", "\n<!-- until here -->"


def options_of(form: Format) -> str:
    styles = ", ".join(f"`{style}`" for style in form.styles)
    flags = {"style": f"`--style` {styles}", "name": "`--name`"}
    return "; ".join(flags[option] for option in form.options if option in flags)


def formats_table() -> str:
    lines = ["| `--to` | what it is | suffix | options | `--check` |", "|---|---|---|---|---|"]
    for name, form in FORMATS.items():
        suffixes = ", ".join(f"`{suffix}`" for suffix in form.suffixes)
        check = "yes" if form.runner else ""
        lines.append(f"| `{name}` | {form.title} | {suffixes} | {options_of(form)} | {check} |")
    return "\n".join(lines) + "\n"


def test_the_documentation_lists_every_format(request):
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(BEGIN)
    _, after = rest.split(END, 1)
    expected = f"{before}{BEGIN}{formats_table()}{END}{after}"
    if request.config.getoption("--update-golden"):
        PAGE.write_text(expected, encoding="utf-8")
    else:
        assert page == expected, "the table is not that of FORMATS; update it: pytest --update-golden"


def test_suffixes_tell_formats_apart():
    assert len(SUFFIXES) == sum(len(form.suffixes) for form in FORMATS.values())
    for suffix, name in SUFFIXES.items():
        assert format_of(suffix[1:]) is FORMATS[name]


@pytest.mark.parametrize("name", list(FORMATS))
def test_a_format_has_a_style_exactly_if_its_writer_takes_one(name):
    form = FORMATS[name]
    assert bool(form.styles) == ("style" in form.options)
