// The drawn tree: fold, walk by keys, light the way of an observation.

const SHOWN_AT_FIRST = 31; // nodes; of a larger tree the least visited parts are folded
const READABLE = 0.45;
const PAPER_WIDTH = 700;

class TreeView {
  /** `onselect(node)` is told what the user looks at, null when nothing is. */
  constructor(policy, onselect) {
    Object.assign(this, { policy, onselect, path: [], current: 0 });
    this.parents = parentsOf(policy.nodes);
    this.boxes = policy.nodes.map((_, i) => boxOf(policy, i));
    this.folded = foldedAtFirst(policy);
    this.drawing = svg("g");
    this.window = svg("svg", { class: "tree-window", role: "tree", "aria-label": "The decision tree" });
    this.window.append(this.drawing);
    this.window.addEventListener("keydown", (event) => this.#key(event));
    this.zoom = new Zoom(this.window, this.drawing);
    this.element = el("div", { class: "tree-box" }, this.window);
  }

  get tools() {
    const label = (name) => ({ "aria-label": name, title: name });
    return [
      button("−", () => this.zoom.by(1 / 1.3), label("Zoom out")),
      button("+", () => this.zoom.by(1.3), label("Zoom in")),
      button("Fit", () => this.fit(0), { title: "Show the whole tree" }),
      button("Unfold all", () => this.unfold()),
    ];
  }

  /** Light the way of an observation. */
  show(path) {
    this.path = path;
    this.#light();
  }

  unfold() {
    this.folded = new Set();
    this.draw();
    this.fit();
  }

  /** Show all of the tree as wide as a sheet of paper, however many sheets that takes. */
  toPaper() {
    this.foldedOnScreen = this.folded;
    this.folded = new Set();
    this.draw({ width: PAPER_WIDTH, height: Infinity });
    const { width, height } = this.layout;
    this.zoom.set(2, 2, 1);
    this.window.setAttribute("viewBox", `0 0 ${width + 4} ${height + 4}`);
    this.window.style.maxWidth = `${width + 4}px`;
  }

  toScreen() {
    this.folded = this.foldedOnScreen ?? this.folded;
    this.window.removeAttribute("viewBox");
    this.window.style.maxWidth = "";
    this.draw();
    this.fit();
  }

  childrenOf = (node) =>
    isLeaf(this.policy.nodes[node]) || this.folded.has(node) ? [] : answersOf(this.policy.nodes[node]);

  /** Draw what is not folded away, downward or sideways, as it is larger in a room of this size. */
  draw(room = { width: this.element.clientWidth, height: Math.max(420, 0.66 * window.innerHeight) }) {
    this.layout = this.#layout(room);
    this.drawn = new Map();
    const edges = svg("g", { class: "edges", role: "presentation" });
    const nodes = svg("g", { role: "presentation" });
    for (const node of this.layout.places.keys()) {
      const element = this.#node(node);
      nodes.append(element);
      this.drawn.set(node, { element });
    }
    for (const [node, drawn] of this.drawn) {
      if (node === 0) continue;
      drawn.edge = this.#edge(this.parents[node], node);
      edges.append(drawn.edge);
    }
    this.drawing.replaceChildren(edges, nodes);
    if (!this.drawn.has(this.current)) this.current = 0;
    this.#light();
  }

  #layout(room) {
    const both = [true, false].map((downward) =>
      arranged(this.childrenOf, (node) => this.boxes[node], downward));
    const scale = (layout) => Math.min(room.width / layout.width, room.height / layout.height, 1);
    return scale(both[1]) > 1.1 * scale(both[0]) ? both[1] : both[0];
  }

  /** Make the window as high as the tree needs, and show all of it, or as much as can be read at this scale. */
  fit(readable = READABLE) {
    const { width, height, downward, places } = this.layout;
    this.fitted = this.element.clientWidth;
    const most = Math.max(320, 0.72 * window.innerHeight);
    const scale = clipped((this.element.clientWidth - 36) / width, READABLE, 1.25);
    this.element.style.height = `${Math.round(clipped(height * scale + 44, 240, most))}px`;
    const view = this.zoom.fit(width, height, readable);
    const root = places.get(0);
    const { clientWidth, clientHeight } = this.window;
    const x = view.x ?? (downward ? clientWidth / 2 - root.x * view.scale : view.margin);
    const y = view.y ?? (downward ? view.margin : clientHeight / 2 - root.y * view.scale);
    this.zoom.set(x, y, view.scale);
  }

  /** Fit anew where the width has changed; a phone that hides its bars changes only the height. */
  resized() {
    if (!matchMedia("print").matches && this.element.clientWidth !== this.fitted) this.fit();
  }

  #node(node) {
    const { x, y } = this.layout.places.get(node);
    const leaf = isLeaf(this.policy.nodes[node]);
    const element = drawnNode(this.policy, node, this.boxes[node]);
    const attributes = {
      transform: `translate(${x} ${y})`,
      role: "treeitem",
      tabindex: node === this.current ? 0 : -1,
      "data-node": node,
      "aria-level": this.layout.depth.get(node) + 1,
      "aria-label": this.#label(node),
      "aria-expanded": leaf ? null : String(!this.folded.has(node)),
      onclick: () => this.#focus(node),
      ondblclick: () => this.#toggle(node),
      onpointerenter: () => this.onselect(node),
      onpointerleave: () => this.onselect(null),
      onfocus: () => this.onselect(node),
      onblur: () => this.onselect(null),
    };
    filled(element, attributes, leaf ? [] : [this.#handle(node)]);
    return element;
  }

  #label(node) {
    const { nodes, visits } = this.policy;
    const parent = this.parents[node];
    const answer = node === 0 ? "" : `${nodes[parent].yes === node ? "Yes" : "No"}: `;
    const share = visits?.[0] ? `, ${shareWords(visits[node] / visits[0])} of decisions` : "";
    return answer + nodes[node].words + (isLeaf(nodes[node]) ? "" : "?") + share;
  }

  /** What folds a subtree, and says how much is folded away. */
  #handle(node) {
    const folded = this.folded.has(node);
    const words = folded ? `+${this.#size(node) - 1}` : "−";
    const width = Math.max(17, textWidth(words, 11, 600) + 9);
    const box = this.boxes[node];
    const [x, y] = this.layout.downward ? [0, box.height / 2] : [box.width / 2, 0];
    return svg(
      "g",
      {
        class: "handle",
        transform: `translate(${x} ${y})`,
        "aria-hidden": "true",
        onclick: (event) => {
          event.stopPropagation();
          this.#toggle(node);
        },
      },
      svg("rect", { x: -width / 2, y: -8.5, width, height: 17, rx: 8.5 }),
      svg("text", null, words),
    );
  }

  #size(node) {
    const all = (i) => (isLeaf(this.policy.nodes[i]) ? [] : answersOf(this.policy.nodes[i]));
    return below(node, all).length;
  }

  #edge(parent, child) {
    const { places, downward } = this.layout;
    const [from, to] = [places.get(parent), places.get(child)];
    const half = (node) => (downward ? this.boxes[node].height : this.boxes[node].width) / 2;
    const start = downward ? [from.x, from.y + half(parent)] : [from.x + half(parent), from.y];
    const end = downward ? [to.x, to.y - half(child)] : [to.x - half(child), to.y];
    const middle = downward ? (start[1] + end[1]) / 2 : (start[0] + end[0]) / 2;
    const bend = downward ? [[start[0], middle], [end[0], middle]] : [[middle, start[1]], [middle, end[1]]];
    const { visits, nodes } = this.policy;
    const width = visits?.[0] ? 1.2 + (8 * visits[child]) / visits[0] : 2;
    const [x, y] = [0, 1].map((axis) => start[axis] * 0.42 + end[axis] * 0.58);
    return svg(
      "g",
      { class: "edge" },
      svg("path", { d: `M${start}C${bend[0]} ${bend[1]} ${end}`, "stroke-width": width }),
      svg("text", { x, y }, nodes[parent].yes === child ? "yes" : "no"),
    );
  }

  #light() {
    const lit = new Set(this.path);
    for (const [node, { element, edge }] of this.drawn ?? []) {
      element.classList.toggle("lit", lit.has(node));
      edge?.classList.toggle("lit", lit.has(node));
    }
    this.window.classList.toggle("has-way", lit.size > 0);
  }

  #toggle(node) {
    if (isLeaf(this.policy.nodes[node])) return;
    if (!this.folded.delete(node)) this.folded.add(node);
    const root = this.layout.places.get(node);
    this.draw();
    // the node stays where it was, and everything else moves around it
    const { x, y, scale } = this.zoom.place;
    const now = this.layout.places.get(node);
    this.zoom.set(x + (root.x - now.x) * scale, y + (root.y - now.y) * scale, scale);
    this.#focus(node);
  }

  #focus(node) {
    this.drawn.get(this.current)?.element.setAttribute("tabindex", -1);
    this.current = node;
    const { element } = this.drawn.get(node);
    element.setAttribute("tabindex", 0);
    element.focus({ preventScroll: true });
    this.#reveal(node);
  }

  /** Move a node into the window. */
  #reveal(node) {
    const place = this.layout.places.get(node);
    const { x, y, scale } = this.zoom.place;
    const push = (at, half, length) =>
      clipped(0, 8 - (at - half), Math.max(8 - (at - half), length - 8 - (at + half)));
    const box = this.boxes[node];
    const dx = push(x + place.x * scale, (box.width / 2) * scale, this.window.clientWidth);
    const dy = push(y + place.y * scale, (box.height / 2) * scale, this.window.clientHeight);
    if (dx || dy) this.zoom.set(x + dx, y + dy, scale);
  }

  #key(event) {
    const shown = below(0, this.childrenOf);
    const at = shown.indexOf(this.current);
    const inner = !isLeaf(this.policy.nodes[this.current]);
    const folded = this.folded.has(this.current);
    const to = (node) => node !== undefined && node >= 0 && this.#focus(node);
    const moves = {
      ArrowDown: () => to(shown[at + 1]),
      ArrowUp: () => to(shown[at - 1]),
      ArrowRight: () => (inner && folded ? this.#toggle(this.current) : to(this.childrenOf(this.current)[0])),
      ArrowLeft: () => (inner && !folded ? this.#toggle(this.current) : to(this.parents[this.current])),
      Home: () => to(0),
      End: () => to(shown.at(-1)),
      Enter: () => this.#toggle(this.current),
      " ": () => this.#toggle(this.current),
      "+": () => this.zoom.by(1.3),
      "-": () => this.zoom.by(1 / 1.3),
      0: () => this.fit(0),
    };
    if (!moves[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    moves[event.key]();
  }
}

/** Unfold the most visited nodes, until so many are shown that no more can be read. */
function foldedAtFirst({ nodes, visits }) {
  const worth = (node) => (visits?.[0] ? visits[node] : -node);
  if (isLeaf(nodes[0])) return new Set();
  const folded = new Set([0]);
  for (let shown = 1; folded.size && shown < SHOWN_AT_FIRST; shown += 2) {
    const next = [...folded].reduce((best, node) => (worth(node) > worth(best) ? node : best));
    folded.delete(next);
    answersOf(nodes[next]).forEach((child) => isLeaf(nodes[child]) || folded.add(child));
  }
  return folded;
}
