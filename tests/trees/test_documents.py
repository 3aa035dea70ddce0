"""Documents say what the tree's own listing says, and a name in them is never more than a name."""

import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group, MultiDiscreteActions
from sympol.trees.text import leaf_words, question, visit_share

from .samples import ACTIONS, HOSTILE_NAMES, random_grouped_tree, random_tree

DOCUMENTS = ("dot", "mermaid", "markdown", "latex")
NAMES = [
    *HOSTILE_NAMES,
    "*/ -- ; DROP TABLE trees; <!-- </script>",
    "1. one\n- two",
    "| a | b |\n---|---",
    "http://a.b www.c.d e@f.g [x](javascript:alert(1)) ![x](y)",
    "`code` ```` **bold** _it_ ~~no~~ # $$x$$",
    "#quot; &lt;b&gt; %% style x fill:#f00;",
    "</td><td onclick='x'>",
    "\\input{/etc/passwd} \\end{forest} ^^41 ]] [[ , {",
    "end\nclick n0 href",
    "Wörter, θ, Ω, 角度, 😀, °C",
    "  spaces  at both ends  ",
]


def named(name: str) -> DecisionTree:
    """Make a tree whose every word is this name."""
    tree = DecisionTree.from_complete(
        np.array([0, 1, 2]),
        np.array([0.5, 0.5, -1.25e-7]),
        np.eye(4),
        actions=MultiDiscreteActions((2, 2), (name, name), ((name, name),) * 2),
        feature_names=[name, "plain", name],
        groups=[Group(name, (0, 1), (name, name))],
    )
    return tree.with_visits([[1, 0, 0], [0, 1, 0], [0, 1, 1]])


def skeleton(form: str, text: str) -> str:
    """What is left when everything that may be a name's is taken away, found as the format's own reader does."""
    if form == "dot":
        return re.sub(r'"(?:[^"\\]|\\.)*"', '""', text, flags=re.S)
    if form == "mermaid":
        return re.sub(r'"[^"]*"', '""', text)
    if form == "markdown":
        return re.sub(r"(?:[^|\n]|\\\|)+", "", text)
    return re.sub(r"\[(\{(?:[^{}]|\{[^{}]*\})*\})", "[{}", text)


@pytest.mark.parametrize("form", DOCUMENTS)
@pytest.mark.parametrize("name", NAMES)
def test_a_name_changes_nothing_around_it(form, name):
    assert skeleton(form, named(name).export(form)) == skeleton(form, named("x").export(form))
    named(name).export(form).encode("utf-8")


def dot_labels(text: str) -> dict[str, str]:
    labels = re.findall(r'^  (n\d+) \[label="((?:[^"\\]|\\.)*)"', text, flags=re.M)
    unescape = {"\\n": "\n", '\\"': '"', "\\\\": "\\"}
    return {
        node: re.sub(r'\\[n"\\]', lambda m: unescape[m[0]], words).replace("&amp;", "&")
        for node, words in labels
    }


def mermaid_labels(text: str) -> dict[str, str]:
    labels = re.findall(r'^  (n\d+)[\[(]"([^"]*)"[\])]$', text, flags=re.M)
    return {node: re.sub(r"#(\d+);", lambda m: chr(int(m[1])), words) for node, words in labels}


def expected_labels(tree: DecisionTree, *, on_one_line: bool = False) -> dict[str, str]:
    def words(node: int) -> str:
        if not tree.is_leaf[node]:
            return question(tree, node).words or " " * on_one_line
        *parts, share = *leaf_words(tree, node), visit_share(tree, node)
        if on_one_line:
            return ", ".join(parts) + (f" ({share})" if share else "") or " "
        return "\n".join(part for part in (*parts, share) if part)

    return {f"n{node}": words(node) for node in range(tree.n_nodes)}


@pytest.mark.parametrize("name", NAMES)
def test_graphs_say_the_name(name):
    tree = named(name)
    assert dot_labels(tree.export("dot")) == expected_labels(tree)
    assert mermaid_labels(tree.export("mermaid")) == expected_labels(tree, on_one_line=True)


@pytest.mark.parametrize("kind", ACTIONS)
def test_graphs_have_the_tree_s_edges(kind):
    rng = np.random.default_rng(5)
    for tree in (random_tree(rng, ACTIONS[kind]), random_grouped_tree(rng, ACTIONS[kind])):
        expected = set()
        for node in np.flatnonzero(~tree.is_leaf).tolist():
            asked = question(tree, node)
            expected |= {(node, "yes", asked.yes_child), (node, "no", asked.no_child)}
        dot = re.findall(r'n(\d+) -> n(\d+) \[label="(\w+)"\];', tree.export("dot"))
        mermaid = re.findall(r"n(\d+) -->\|(\w+)\| n(\d+)$", tree.export("mermaid"), flags=re.M)
        assert {(int(a), word, int(b)) for a, b, word in dot} == expected
        assert {(int(a), word, int(b)) for a, word, b in mermaid} == expected
        assert dot_labels(tree.export("dot")) == expected_labels(tree)
        assert mermaid_labels(tree.export("mermaid")) == expected_labels(tree, on_one_line=True)


# ---- Markdown, by a real reader ----


class Cells(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.rows: list[list[str]] = []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        assert all(name == "style" for name, _ in attrs)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_data(self, data):
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


def table(text: str) -> list[list[str]]:
    markdown = pytest.importorskip("markdown")
    cells = Cells()
    cells.feed(markdown.markdown(text, extensions=["tables"]))
    assert cells.tags <= {"table", "thead", "tbody", "tr", "th", "td"}
    return [[cell.strip() for cell in row] for row in cells.rows]


@pytest.mark.parametrize("name", NAMES)
def test_a_markdown_table_says_the_rules(name):
    tree = named(name)
    head, *rows = table(tree.export("markdown"))
    assert head == ["When", "Action", "Visits"]
    said = [
        f"If {when}: {action} ({visits})." if visits else f"If {when}: {action}."
        for when, action, visits in rows
    ]
    # a rule without conditions reads "Always", one whose conditions have no words, too: a table tells them apart
    rules = [rule.replace("Always:", "If :") for rule in tree.rules()]
    assert [squeezed(rule) for rule in said] == [squeezed(rule) for rule in rules]


def squeezed(words: str) -> str:
    """Readers of HTML count spaces as one."""
    return re.sub(r"\s+", " ", words).replace(" :", ":")


@pytest.mark.parametrize("form", DOCUMENTS)
def test_thresholds_have_the_digits_asked_for(cartpole, form):
    assert "0.021" in cartpole.export(form)
    assert "0.021" not in cartpole.export(form, digits=1)


def test_a_markdown_table_has_visits_where_they_are_known_and_says_always():
    tree = DecisionTree.from_complete(
        np.zeros(0, int),
        np.zeros(0),
        np.eye(1, 2),
        actions=DiscreteActions(2, ("go", "stop")),
        feature_names=["x"],
    )
    assert tree.export("markdown").splitlines()[2:] == ["| always | go |"]
    assert tree.with_visits([[0.0]]).export("markdown").splitlines()[2:] == ["| always | go | 100 % |"]


def test_markdown_makes_no_links_of_names():
    written = named("http://a.b www.c.d e@f.g").export("markdown")
    assert not re.search(r"://|www\.|@", written)


# ---- LaTeX ----


def test_latex_prints_every_character_as_itself():
    every = "".join(map(chr, range(32, 127)))
    words = named(every).export("latex")
    shown = re.findall(r"\[\{((?:[^{}]|\{[^{}]*\})*)\}, yes, action\]", words)[0].split(r"\\")[0]
    as_text = {
        "textbackslash": "\\",
        "textasciicircum": "^",
        "textasciitilde": "~",
        "textless": "<",
        "textgreater": ">",
    }
    shown = re.sub(r"\{\\char(\d+)\}", lambda m: chr(int(m[1])), shown)
    shown = re.sub(r"\{\\(text\w+)\}", lambda m: as_text[m[1]], shown)
    assert shown == f"{every}: {every}"


@pytest.mark.parametrize("name", NAMES)
def test_latex_has_no_command_of_a_name_s(name):
    words = "leq|ttfamily|theta|Omega|text(?:backslash|asciicircum|asciitilde|less|greater|degree)"
    known = rf"\\char\d+|\\(?:{words})|\\\\"
    text = (
        named(name)
        .export("latex")
        .split("action/.style={rounded corners}\n")[1]
        .removesuffix("\\end{forest}\n")
    )
    text = re.sub(known, "", text)
    assert not re.search(r"[\\#%&_~^`'\"]", text)
    assert text.replace("$-$", "").replace("$^2$", "").count("$") % 2 == 0
    assert text.count("{") == text.count("}")
    assert text.count("[") == text.count("]")


@pytest.mark.parametrize("kind", ACTIONS)
def test_latex_nests_as_the_tree_does(kind):
    tree = random_tree(np.random.default_rng(9), ACTIONS[kind])
    words, way, expected = tree.export("latex").split("corners}\n")[1].splitlines()[:-1], [], []
    awaited = [(0, 0, "")]
    while awaited:
        node, depth, edge = awaited.pop()
        expected.append((depth, edge, bool(tree.is_leaf[node]), question_or_action(tree, node)))
        if not tree.is_leaf[node]:
            asked = question(tree, node)
            awaited += [(asked.no_child, depth + 1, ", no"), (asked.yes_child, depth + 1, ", yes")]
    for line in words:
        if line.strip() != "]":
            depth = (len(line) - len(line.lstrip())) // 2
            edge = next((edge for edge in (", yes", ", no") if edge in line.split("}")[-1]), "")
            text = re.findall(r"\[\{(.*)\}", line)[0].split(r"\\")[0]
            way.append((depth, edge, line.endswith(", action]"), text.replace(r"{$\leq$}", "≤")))
    assert way == [
        (*head, words.replace("[", r"{\char91}").replace("]", r"{\char93}")) for *head, words in expected
    ]


def question_or_action(tree: DecisionTree, node: int) -> str:
    return leaf_words(tree, node)[0] if tree.is_leaf[node] else question(tree, node).words


def has_tex(*packages: str) -> bool:
    return bool(shutil.which("pdflatex")) and all(
        subprocess.run(["kpsewhich", package], capture_output=True, check=False).returncode == 0
        for package in packages
    )


@pytest.mark.slow
def test_latex_compiles(tmp_path):
    if not has_tex("forest.sty", "environ.sty"):
        pytest.skip("no pdflatex with forest: apt-get install texlive-latex-extra texlive-pictures")
    pictures = [named(name) for name in NAMES]
    rng = np.random.default_rng(6)
    pictures += [random_tree(rng, actions) for actions in ACTIONS.values()]
    for i, tree in enumerate(pictures):
        (tmp_path / f"tree{i}.tex").write_text(tree.export("latex"), encoding="utf-8")
    inputs = "\n\n".join(f"\\resizebox{{10cm}}{{!}}{{\\input{{tree{i}.tex}}}}" for i in range(len(pictures)))
    page = "\\documentclass{article}\\usepackage[T1]{fontenc}\\usepackage{forest}\\begin{document}\n"
    (tmp_path / "page.tex").write_text(f"{page}{inputs}\n\\end{{document}}\n", encoding="utf-8")
    command = ["pdflatex", "-no-shell-escape", "-interaction=nonstopmode", "-halt-on-error", "page.tex"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, errors="replace", check=False
    )
    assert done.returncode == 0, done.stdout[-2000:]


# ---- Graphviz and Mermaid themselves ----


@pytest.mark.parametrize("name", NAMES)
def test_graphviz_draws_the_name(name):
    if not shutil.which("dot"):
        pytest.skip("no dot: apt-get install graphviz")
    tree = named(name)
    done = subprocess.run(
        ["dot", "-Tsvg"], input=tree.export("dot").encode(), capture_output=True, check=True, timeout=30
    )
    assert not done.stderr
    svg = ET.fromstring(done.stdout)
    tags = {element.tag.split("}")[1] for element in svg.iter()}
    assert tags <= {"svg", "g", "title", "polygon", "path", "text"}
    texts = [element.text or "" for element in svg.iter("{http://www.w3.org/2000/svg}text")]
    expected = [line for words in expected_labels(tree).values() for line in words.split("\n") if line]
    drawn = sorted(squeezed(text.replace("\xa0", " ")).strip() for text in texts if text not in ("yes", "no"))
    assert drawn == sorted(squeezed(line).strip() for line in expected)


MERMAID = Path.home() / ".cache/sympol-tests/node_modules/mermaid/dist/mermaid.min.js"
RENDER = """async text => {
    mermaid.initialize({startOnLoad: false});
    const place = document.getElementById("place");
    place.innerHTML = (await mermaid.render("drawn", text)).svg;
    return {
        words: [...place.querySelectorAll(".nodeLabel")].map(label => label.innerText),
        foreign: place.querySelectorAll("script, a, img, b, em, strong, code, ul, ol, math").length,
    };
}"""


@pytest.mark.slow
def test_mermaid_draws_the_names():
    sync_api = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium")
    if chromium is None or not MERMAID.is_file():
        pytest.skip(f"no chromium, or no {MERMAID}: run tests/install-tools.sh")
    with sync_api.sync_playwright() as playwright:
        options = ["--no-sandbox"] if os.getuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=chromium, args=options)
        page = browser.new_page()
        page.set_content('<div id="place"></div>')
        page.add_script_tag(path=str(MERMAID))
        for name in NAMES:
            tree = named(name)
            drawn = page.evaluate(RENDER, tree.export("mermaid"))
            assert drawn["foreign"] == 0
            expected = [squeezed(words).strip() for words in expected_labels(tree, on_one_line=True).values()]
            assert sorted(squeezed(words).strip() for words in drawn["words"]) == sorted(expected)
        browser.close()
