// How the tree decides, to the bit: numbers are float32, subnormals count as zero, and only x ≤ t goes left.

const SMALLEST_NORMAL = 2 ** -126;

function flushed(x) {
  const rounded = Math.fround(x);
  return Math.abs(rounded) < SMALLEST_NORMAL ? rounded * 0 : rounded;
}

function isLeaf(node) {
  return node.answer !== undefined;
}

/** The nodes an observation comes by, from the root to a leaf. NaN is not ≤ anything and goes right. */
function pathOf(nodes, observation) {
  const path = [0];
  for (let node = nodes[0]; !isLeaf(node); node = nodes[path[path.length - 1]]) {
    const left = flushed(observation[node.feature]) <= Math.fround(node.threshold);
    path.push(left ? node.left : node.right);
  }
  return path;
}

function leafOf(nodes, observation) {
  return pathOf(nodes, observation).at(-1);
}

/** Each node's parent; -1 for the root. */
function parentsOf(nodes) {
  const parents = new Array(nodes.length).fill(-1);
  nodes.forEach((node, i) => {
    if (!isLeaf(node)) parents[node.left] = parents[node.right] = i;
  });
  return parents;
}

/** The children of an inner node as they are asked for: yes, no. */
function answersOf(node) {
  return node.yes === node.left ? [node.left, node.right] : [node.right, node.left];
}

/** The features that an observation is asked for on a way. */
function askedOn(nodes, path) {
  return new Set(path.filter((i) => !isLeaf(nodes[i])).map((i) => nodes[i].feature));
}
