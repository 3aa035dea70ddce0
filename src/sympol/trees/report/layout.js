// Where nodes go: a tidy tree, as narrow as boxes of different sizes allow (Reingold and Tilford, 1981).

/**
 * Centres of the nodes below `root` on the axis along which siblings lie, relative to the root's.
 * `childrenOf(node)` are those shown, `sizeOf(node)` is a node's size on this axis.
 */
function tidy(root, childrenOf, sizeOf, gap) {
  const offset = new Map();
  const outline = (node) => {
    const half = sizeOf(node) / 2;
    const [first, second] = childrenOf(node).map((child) => ({ child, sides: outline(child) }));
    if (first === undefined) return [[-half, half]];
    const shared = Math.min(first.sides.length, second.sides.length);
    let apart = 0;
    for (let i = 0; i < shared; i++) apart = Math.max(apart, first.sides[i][1] - second.sides[i][0]);
    const step = (apart + gap) / 2;
    offset.set(first.child, -step);
    offset.set(second.child, step);
    const below = [];
    for (let i = 0; i < Math.max(first.sides.length, second.sides.length); i++) {
      const low = i < first.sides.length ? first.sides[i][0] - step : second.sides[i][0] + step;
      const high = i < second.sides.length ? second.sides[i][1] + step : first.sides[i][1] - step;
      below.push([low, high]);
    }
    return [[-half, half], ...below];
  };
  const sides = outline(root);
  const centre = new Map([[root, 0]]);
  for (const node of below(root, childrenOf))
    if (node !== root) centre.set(node, offset.get(node)); // made absolute below, parents first
  for (const node of below(root, childrenOf))
    for (const child of childrenOf(node)) centre.set(child, centre.get(child) + centre.get(node));
  const least = Math.min(...sides.map(([low]) => low));
  const extent = Math.max(...sides.map(([, high]) => high)) - least;
  centre.forEach((x, node) => centre.set(node, x - least));
  return { centre, extent };
}

/** The nodes shown, parents first, a yes before a no. */
function below(root, childrenOf) {
  const nodes = [];
  const awaited = [root];
  while (awaited.length) {
    const node = awaited.pop();
    nodes.push(node);
    awaited.push(...childrenOf(node).toReversed());
  }
  return nodes;
}

/** Centres on the axis along which children follow their parents: levels as thick as their thickest box. */
function levels(root, childrenOf, sizeOf, gap) {
  const depth = new Map([[root, 0]]);
  const thickness = [];
  for (const node of below(root, childrenOf)) {
    const level = depth.get(node);
    thickness[level] = Math.max(thickness[level] ?? 0, sizeOf(node));
    childrenOf(node).forEach((child) => depth.set(child, level + 1));
  }
  const middle = [];
  let end = 0;
  thickness.forEach((size, level) => {
    middle[level] = end + size / 2;
    end += size + gap;
  });
  const centre = new Map([...depth].map(([node, level]) => [node, middle[level]]));
  return { centre, extent: end - gap, depth };
}

/** The whole tree, its root at the top or at the left. */
function arranged(childrenOf, boxOf, downward) {
  const [across, along] = downward ? ["width", "height"] : ["height", "width"];
  const side = tidy(0, childrenOf, (node) => boxOf(node)[across], downward ? 22 : 12);
  const ahead = levels(0, childrenOf, (node) => boxOf(node)[along], downward ? 46 : 64);
  const places = new Map(
    [...side.centre].map(([node, s]) => {
      const a = ahead.centre.get(node);
      return [node, downward ? { x: s, y: a } : { x: a, y: s }];
    }),
  );
  const extent = downward ? [side.extent, ahead.extent] : [ahead.extent, side.extent];
  return { places, width: extent[0], height: extent[1], depth: ahead.depth, downward };
}
