// The observation that the tree is asked: a slider and a number for each feature, a list for each group.

const NOTCHES = 500;

class ObservationPanel {
  /** `onchange(observation)` is told what the user makes of it. */
  constructor(policy, onchange) {
    Object.assign(this, { policy, onchange });
    this.values = policy.features.map(({ low, high }) => clipped(0, low, high));
    policy.groups.forEach(({ features }) => this.#choose(features, 0));
    const grouped = new Set(policy.groups.flatMap(({ features }) => features));
    const asked = new Set(policy.nodes.filter((node) => !isLeaf(node)).map((node) => node.feature));
    this.rows = [];
    policy.features.forEach((feature, i) => grouped.has(i) || this.rows.push(this.#numberRow(feature, i)));
    policy.groups.forEach((group) => this.rows.push(this.#groupRow(group)));
    const isAsked = (row) => row.features.some((i) => asked.has(i));
    const used = this.rows.filter(isAsked).map(({ element }) => element);
    const unused = this.rows.filter((row) => !isAsked(row)).map(({ element }) => element);
    this.element = el("div", { class: "observation-rows" }, ...used);
    if (unused.length)
      this.element.append(
        el("details", { class: "unasked", open: used.length + unused.length <= 4 },
          el("summary", null, `${unused.length} the tree never asks for`), ...unused));
  }

  /** Show an observation; `asked` are the features that the way of it asks for. */
  show(observation, asked) {
    this.values = Array.from(observation);
    for (const row of this.rows) {
      row.update();
      row.element.classList.toggle("asked", row.features.some((i) => asked.has(i)));
    }
  }

  #change(i, value) {
    this.values[i] = flushed(value);
    this.onchange(this.values.slice());
  }

  #choose(features, chosen) {
    features.forEach((feature, i) => (this.values[feature] = i === chosen ? 1 : 0));
  }

  #numberRow({ name, low, high, integer, splits }, i) {
    const step = integer ? 1 : (high - low) / NOTCHES || 1;
    const label = `slider-${i}`;
    const slider = el("input", {
      type: "range", id: label, min: low, max: high, step,
      oninput: () => this.#change(i, Number(slider.value)),
    });
    const number = el("input", {
      type: "text", class: "number", inputmode: "decimal", "aria-label": `${name}, exact`, size: 8,
      onchange: () => this.#typed(i, number),
      onfocus: () => (number.value = exactWords(this.values[i])),
      onblur: () => number.hasAttribute("aria-invalid") || update(),
      onkeydown: (event) => event.stopPropagation(),
    });
    const marks = splits
      .filter((t) => t >= low && t <= high)
      .map((t) => svg("line", { x1: (100 * (t - low)) / (high - low || 1), x2: (100 * (t - low)) / (high - low || 1), y2: 6 }));
    const scale = svg("svg", { class: "splits", viewBox: "0 0 100 6", preserveAspectRatio: "none", "aria-hidden": "true" }, ...marks);
    const track = el("span", { class: "track" }, slider, scale);
    const update = () => {
      const value = this.values[i];
      slider.value = Number.isNaN(value) ? high : clipped(value, low, high);
      slider.setAttribute("aria-valuetext", numberWords(value));
      if (document.activeElement !== number) number.value = numberWords(value);
    };
    return { features: [i], update, element: el("div", { class: "row" }, el("label", { for: label }, name), track, number) };
  }

  #typed(i, field) {
    const words = field.value.trim().replace("−", "-").toLowerCase();
    const special = { nan: NaN, inf: Infinity, "∞": Infinity, "-inf": -Infinity, "-∞": -Infinity };
    const value = Object.hasOwn(special, words) ? special[words] : words === "" ? NaN : Number(words);
    const wrong = Number.isNaN(value) && words !== "nan";
    field.toggleAttribute("aria-invalid", wrong);
    if (!wrong) this.#change(i, value);
  }

  #groupRow({ name, features, categories }) {
    const select = el("select", { onchange: () => this.#pick(features, select.selectedIndex), "aria-label": name || "choice" },
      ...categories.map((category) => el("option", null, category)));
    const update = () => (select.selectedIndex = features.findIndex((i) => this.values[i] === 1));
    const element = el("div", { class: "row choice" }, el("label", null, name || "choice", select));
    return { features, update, element };
  }

  #pick(features, chosen) {
    this.#choose(features, chosen);
    this.onchange(this.values.slice());
  }
}
