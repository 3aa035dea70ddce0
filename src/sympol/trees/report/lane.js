// One policy among others: what it sees and does and, if it is a tree, its way.

class Lane {
  constructor({ name, kind, policy, episodes }, drawing, columns) {
    Object.assign(this, { name, policy, episodes });
    this.stage = new Stage(drawing, columns);
    this.tree = policy && new TreeView(policy, (node) => this.#describe(node));
    this.said = el("p", { class: "quiet said" });
    const tree = this.tree && [this.tree.element, el("div", { class: "tools" }, ...this.tree.tools), this.said];
    this.element = el("section", { class: "lane", "aria-label": name },
      el("h3", null, name), el("p", { class: "quiet" }, kind), this.stage.element, ...(tree ?? []));
  }

  draw() {
    this.tree?.draw();
    this.tree?.fit();
  }

  start(episode) {
    this.stage.episode = this.episodes[episode];
  }

  show(step) {
    this.stage.show(step);
    if (!this.tree) return;
    this.path = pathOf(this.policy.nodes, this.stage.observation(step));
    this.tree.show(this.path);
    this.#describe(null);
  }

  #describe(node) {
    const at = this.policy.nodes[node ?? this.path?.at(-1) ?? 0];
    this.said.textContent = at.rule ?? `${at.words}?`;
  }
}
