// What the nodes of the drawn tree look like.

const FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif';
const ROW = 19;
const SMALL_ROW = 15;
const PAD = 9;
const LONGEST = 34;
const LARGEST_CELL = 20;
const LARGEST_GRID = 160;

const ruler = document.createElement("canvas").getContext("2d");

function textWidth(words, size, weight) {
  ruler.font = `${weight} ${size}px ${FONT}`;
  return ruler.measureText(words).width;
}

function shortened(words) {
  return words.length <= LONGEST ? words : `${words.slice(0, LONGEST - 1)}…`;
}

/** What share of the visits came by, and how many: `62 % · 1,234`. */
function visitWords(policy, node) {
  if (!policy.visits?.[0]) return "";
  const count = policy.visits[node];
  return `${shareWords(count / policy.visits[0])} · ${count.toLocaleString("en")}`;
}

/** How large a node is drawn. */
function boxOf(policy, index) {
  const node = policy.nodes[index];
  const small = visitWords(policy, index);
  const grid = node.view ? policy.side * cellSize(policy.side) : 0;
  const widths = node.lines.map((line) => textWidth(shortened(line), 13, 600));
  return {
    width: Math.max(grid, textWidth(small, 11, 400), ...widths) + 2 * PAD + 6,
    height: (grid && grid + 6) + node.lines.length * ROW + (small ? SMALL_ROW : 0) + PAD + (isLeaf(node) ? 3 : 9), // the handle lies on the edge
  };
}

function cellSize(side) {
  return Math.min(LARGEST_CELL, LARGEST_GRID / side);
}

/** Draw a node around the origin. */
function drawnNode(policy, index, box) {
  const node = policy.nodes[index];
  const small = visitWords(policy, index);
  const whole = isLeaf(node) && node.colours.length === 1 ? node.colours[0] : null;
  const group = svg("g", { class: isLeaf(node) ? "leaf" : "inner" });
  const frame = { x: -box.width / 2, y: -box.height / 2, width: box.width, height: box.height };
  group.append(svg("rect", { ...frame, class: "body", rx: isLeaf(node) ? 13 : 7, fill: whole?.[0] }));
  let y = -box.height / 2 + PAD / 2 + 2;
  if (node.view) {
    group.append(drawnView(policy, node.view, y + 2));
    y += policy.side * cellSize(policy.side) + 6;
  }
  node.lines.forEach((line, row) => {
    const [paint, ink] = isLeaf(node) ? node.colours[row] : [null, null];
    if (paint && !whole) group.append(svg("rect", { ...pill(box, y), fill: paint }));
    const bold = row === node.lines.length - 1 ? "strong" : "plain";
    group.append(written(bold, y + ROW / 2, shortened(line), ink));
    y += ROW;
  });
  if (small) group.append(written("small", y + SMALL_ROW / 2, small, whole?.[1]));
  return group;
}

/** Words in an ink that suits what they stand on, or in the page's own. */
function written(name, y, words, ink) {
  const text = svg("text", { class: name, y }, words);
  if (ink) text.style.fill = ink;
  return text;
}

function pill(box, y) {
  return { x: 5 - box.width / 2, y: y + 0.5, width: box.width - 10, height: ROW - 1, rx: 8 };
}

/** What an agent sees, with what is asked for in one cell of it. The agent is in the middle of the lowest row. */
function drawnView(policy, view, top) {
  const { side } = policy;
  const size = cellSize(side);
  const group = svg("g", { class: "view", transform: `translate(${(-side * size) / 2} ${top}) scale(${size})` });
  for (let row = 0; row < side; row++)
    for (let column = 0; column < side; column++)
      group.append(svg("rect", { x: column, y: row, width: 1, height: 1, class: "cell" }));
  const agent = [side - 1, Math.floor(side / 2)];
  const [row, column] = view.cell;
  if (agent[0] !== row || agent[1] !== column)
    group.append(svg("path", { class: "agent", d: "M.5 .16 L.82 .84 L.18 .84 Z", transform: moved(agent) }));
  group.append(drawnGlyph(policy.glyphs[view.glyph], [row, column]));
  return group;
}

function drawnGlyph(glyph, cell) {
  const group = svg("g", { transform: moved(cell) });
  group.append(svg("rect", { width: 1, height: 1, class: "asked" }));
  for (const { points, fill, line, width } of glyph.lines) {
    const d = `M${points.map(([x, y]) => `${x} ${y}`).join("L")}`;
    group.append(svg("path", { d, fill, stroke: line, "stroke-width": width / 18 }));
  }
  if (!glyph.lines.length && glyph.category.toLowerCase() !== "empty")
    group.append(svg("text", { class: "category", x: 0.5, y: 0.52 }, glyph.category.slice(0, 6)));
  group.append(svg("rect", { width: 1, height: 1, class: "rim" }));
  return group;
}

function moved([row, column]) {
  return `translate(${column} ${row})`;
}
