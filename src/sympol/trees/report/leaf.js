// What is known of one node: a leaf's rule, its region, its answer; an inner node's question.

class NodePanel {
  constructor(policy) {
    this.policy = policy;
    this.element = el("div", { class: "node-panel" });
  }

  /** Describe a node, and how it comes to be described: "reached now", "under the pointer". */
  show(node, how) {
    if (this.node === node && this.how === how) return;
    Object.assign(this, { node, how });
    const described = this.policy.nodes[node];
    const parts = isLeaf(described) ? this.#leaf(described) : this.#inner(described);
    const visits = visitWords(this.policy, node);
    const kind = isLeaf(described) ? "Leaf" : "Question";
    const head = `${kind} ${how}${visits ? ` · ${visits} decisions` : ""}`;
    this.element.replaceChildren(el("p", { class: "eyebrow" }, head), ...parts);
  }

  #leaf(leaf) {
    const region = leaf.region.length
      ? el("ul", { class: "region" }, ...leaf.region.map((condition) => this.#condition(condition)))
      : el("p", { class: "quiet" }, "Every observation ends here.");
    return [
      el("p", { class: "rule" }, leaf.rule),
      el("div", { class: "columns" },
        el("div", null, el("h3", null, "Region"), region),
        el("div", null, el("h3", null, "Answer"), ...leaf.answer.map(answerPart))),
    ];
  }

  #condition({ words, feature, above, most }) {
    if (feature === undefined) return el("li", null, el("span", null, words));
    const { low, high } = this.policy.features[feature];
    const at = (x) => clipped((x - low) / (high - low || 1), 0, 1) * 100;
    const from = above === null ? 0 : at(above);
    const to = most === null ? 100 : at(most);
    const bar = svg("svg", { class: "interval", viewBox: "0 0 100 6", preserveAspectRatio: "none", "aria-hidden": "true" },
      svg("rect", { class: "track", width: 100, height: 6, rx: 1 }),
      svg("rect", { class: "inside", x: from, width: Math.max(to - from, 0.8), height: 6 }));
    return el("li", null, el("span", null, words), bar);
  }

  #inner(node) {
    const { visits } = this.policy;
    const way = (child, answer) => {
      const share = visits?.[0] ? visits[child] / Math.max(1, visits[node.left] + visits[node.right]) : null;
      return barRow(answer, share, null, share === null ? "" : shareWords(share));
    };
    const [yes, no] = answersOf(node);
    const ways = visits?.[0] ? [el("div", { class: "bars" }, way(yes, "yes"), way(no, "no"))] : [];
    return [el("p", { class: "rule" }, `${node.words}?`), ...ways];
  }
}

/** One component of an answer: the chances of its options, or a number in its range. */
function answerPart(part) {
  const name = part.name ? el("h4", null, part.name) : null;
  if (part.bars)
    return el("div", { class: "bars" }, name,
      ...part.bars.map(([option, chance, colour]) => barRow(option, chance, colour, shareWords(chance))));
  const { low, high, value } = part;
  const share = low === null || high === null ? null : (value - low) / (high - low || 1);
  return el("div", { class: "bars" }, barRow(part.name, share, part.colour, part.words));
}

/** A name, a bar and its words; without a share there is no bar. */
function barRow(name, share, colour, words) {
  const bar = el("span", { class: "bar" });
  if (share !== null) {
    const filling = el("span", { class: "filling" });
    filling.style.width = `${100 * clipped(share, 0, 1)}%`;
    if (colour) filling.style.background = colour;
    bar.append(filling);
  }
  return el("div", { class: "bar-row" }, el("span", { class: "bar-name", title: name }, name), bar, el("span", { class: "bar-words" }, words));
}
