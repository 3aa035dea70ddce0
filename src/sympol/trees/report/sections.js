// The parts of a page that only tell: head, facts, properties, programs, where all this comes from.

function pageHead(data, ...tools) {
  const facts = data.facts.map(([value, label]) =>
    el("div", { class: "fact" }, el("dd", null, value), el("dt", null, label)));
  return el("header", { class: "page-head" },
    el("div", { class: "title" }, el("p", { class: "eyebrow" }, data.kicker), el("h1", null, data.title)),
    el("dl", { class: "facts" }, ...facts),
    el("div", { class: "tools" }, ...tools, themeButton()));
}

/** Light or dark: as the system says, until one chooses. */
function themeButton() {
  const dark = () => (document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const theme = button("◐", () => {
    document.documentElement.dataset.theme = dark() ? "light" : "dark";
    theme.setAttribute("aria-pressed", dark());
  }, { class: "theme", "aria-label": "Dark colours", title: "Light or dark", "aria-pressed": dark() });
  return theme;
}

function legend(parts) {
  return el("div", { class: "legend" }, ...parts.map(({ name, options }) =>
    el("p", null, name ? `${name}: ` : null, ...options.map(([option, colour]) => {
      const swatch = el("i", { class: "swatch" });
      swatch.style.background = colour;
      return el("span", null, swatch, option);
    }))));
}

function importanceCard(rows) {
  const bars = rows.map(({ name, share }) => barRow(name, share, null, shareWords(share)));
  return card("importance", "What decides", null,
    el("p", { class: "quiet" }, "The share of decisions that ask for a feature at least once."),
    el("div", { class: "bars wide" }, ...bars));
}

function returnsCard(tests) {
  const [least, most] = [Math.min(...tests.returns), Math.max(...tests.returns)];
  const range = least === most ? "all alike" : `from ${numberWords(least)} to ${numberWords(most)}`;
  return card("returns", "Test episodes", null,
    el("p", { class: "headline" }, el("strong", null, tests.words),
      el("span", null, ` over ${tests.returns.length} episodes, ${range}`)),
    least === most ? null : histogram(tests));
}

function trainingCard(series) {
  return card("training", "Training", null, curves(series, "environment steps", "return"));
}

/** `onshow(observation)` puts a counterexample before the tree. */
function checksCard(checks, columns, onshow) {
  const failed = checks.filter(({ holds }) => !holds).length;
  const head = failed ? `${failed} of ${checks.length} do not hold` : `All ${checks.length} proven`;
  const rows = checks.map(({ name, rule, holds, words, counterexample }) =>
    el("li", { class: holds ? "holds" : "fails" },
      el("span", { class: "mark", role: "img", "aria-label": holds ? "holds" : "fails" }, holds ? "✓" : "✗"),
      el("div", null, el("strong", null, name), rule === name ? null : el("p", null, rule), el("p", { class: "quiet" }, words),
        counterexample ? button("Show in the tree", () => onshow(unpacked(counterexample, columns)[0])) : null)));
  return card("checks", "Properties", null, el("p", { class: "headline" }, el("strong", null, head)), el("ul", null, ...rows));
}

function rulesCard(policy) {
  const rules = policy.order.map((leaf) => {
    const swatch = el("i", { class: "swatch" });
    swatch.style.background = policy.nodes[leaf].colours[0][0];
    return el("li", null, swatch, el("span", null, policy.nodes[leaf].rule));
  });
  const list = el("ol", { class: "rules-list" }, ...rules);
  const all = rules.length > 16 ? el("details", null, el("summary", null, `All ${rules.length} rules`), list) : list;
  return card("rules", "The policy in words", null, all);
}

/** The tree as programs and documents, a tab each. */
function programsCard(programs) {
  const code = el("code");
  const panel = el("pre", { role: "tabpanel", id: "program", tabindex: 0, "aria-label": "Program" }, code);
  const copy = button("Copy", () => copied(code, copy), { class: "copy" });
  const tabs = programs.map((program, i) =>
    button(program.name, () => choose(i), { role: "tab", title: program.title, "aria-controls": "program" }));
  const list = el("div", { class: "tabs", role: "tablist", "aria-label": "Formats", onkeydown: (event) => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (by) choose((tabs.indexOf(document.activeElement) + by + tabs.length) % tabs.length, true);
  } }, ...tabs);
  const choose = (chosen, focus) => {
    code.textContent = programs[chosen].text;
    tabs.forEach((tab, i) => {
      tab.setAttribute("aria-selected", i === chosen);
      tab.setAttribute("tabindex", i === chosen ? 0 : -1);
    });
    if (focus) tabs[chosen].focus();
  };
  choose(0);
  return card("programs", "Take it with you", [copy], list, panel);
}

async function copied(code, sign) {
  try {
    await navigator.clipboard.writeText(code.textContent);
  } catch {
    // no leave to write: what is selected can still be copied by hand
    getSelection().selectAllChildren(code);
    document.execCommand("copy");
  }
  sign.textContent = "Copied";
  setTimeout(() => (sign.textContent = "Copy"), 1500);
}

function provenanceCard({ rows, config }) {
  const list = el("dl", { class: "provenance-list" }, ...rows.flatMap(([name, value]) => [el("dt", null, name), el("dd", null, value)]));
  const details = config && el("details", null, el("summary", null, "Every hyperparameter"), el("pre", null, config));
  return card("provenance", "Where this comes from", null, list, details);
}

/** On paper everything is open, and afterwards as it was. */
function whenPrinted(trees) {
  const paper = matchMedia("print");
  let opened = [];
  paper.addEventListener("change", () => {
    if (paper.matches) opened = [...document.querySelectorAll("details:not([open])")];
    opened.forEach((details) => (details.open = paper.matches));
    trees.forEach((tree) => (paper.matches ? tree.toPaper() : tree.toScreen()));
  });
}
