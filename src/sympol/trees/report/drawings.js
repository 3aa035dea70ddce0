// Drawings of Gymnasium's classic environments out of what is observed: smooth, sharp and without a byte of film.
// Each returns shapes in a view that is 300 wide and 200 high, y downward.

const DRAWINGS = {
  "CartPole-v1": drawnCartPole,
  "Pendulum-v1": drawnPendulum,
  "Acrobot-v1": drawnAcrobot,
  "MountainCar-v0": drawnMountainCar,
  "MountainCarContinuous-v0": drawnMountainCar,
};

function drawn(name, observation) {
  const shapes = DRAWINGS[name](Array.from(observation, (x) => (Number.isFinite(x) ? x : 0)));
  return svg("svg", { class: "drawing", viewBox: "0 0 300 200", "aria-hidden": "true" }, ...shapes);
}

function line(x1, y1, x2, y2, name) {
  return svg("line", { x1, y1, x2, y2, class: name });
}

function dot(cx, cy, r, name) {
  return svg("circle", { cx, cy, r, class: name });
}

function drawnCartPole([position, , angle]) {
  const scale = 300 / 4.8; // the episode ends 2.4 m from the middle
  const [x, y] = [150 + clipped(position, -2.6, 2.6) * scale, 140];
  const end = [x + Math.sin(angle) * 100, y - 8 - Math.cos(angle) * 100];
  return [
    line(-400, 152, 700, 152, "ground"), // beyond the picture, however wide it is
    svg("rect", { x: x - 25, y: y - 12, width: 50, height: 24, rx: 3, class: "thing" }),
    line(x, y - 8, ...end, "pole"),
    dot(x, y - 8, 4, "joint"),
  ];
}

function drawnPendulum([cos, sin]) {
  const end = [150 - sin * 78, 100 - cos * 78];
  return [dot(150, 100, 86, "reach"), line(150, 100, ...end, "rod"), dot(150, 100, 5, "joint")];
}

function drawnAcrobot([cos1, sin1, cos2, sin2]) {
  const length = 44;
  const elbow = [150 + sin1 * length, 100 + cos1 * length];
  // the second angle is measured from the first link
  const sin = sin1 * cos2 + cos1 * sin2;
  const cos = cos1 * cos2 - sin1 * sin2;
  const hand = [elbow[0] + sin * length, elbow[1] + cos * length];
  return [
    line(20, 100 - length, 280, 100 - length, "goal-line"),
    line(150, 100, ...elbow, "rod"),
    line(...elbow, ...hand, "rod second"),
    dot(150, 100, 5, "joint"),
    dot(...elbow, 4, "joint"),
  ];
}

function drawnMountainCar([position]) {
  const height = (x) => 160 - (Math.sin(3 * x) * 0.45 + 0.55) * 110;
  const across = (x) => ((x + 1.2) / 1.8) * 300;
  const hill = [];
  for (let x = -1.2; x <= 0.6001; x += 0.02) hill.push(`${across(x).toFixed(1)} ${height(x).toFixed(1)}`);
  const x = clipped(position, -1.2, 0.6);
  const slope = (Math.atan2(height(x + 0.01) - height(x - 0.01), across(x + 0.01) - across(x - 0.01)) * 180) / Math.PI;
  const [goal, top] = [across(0.5), height(0.5)];
  return [
    svg("path", { d: `M${hill.join("L")}`, class: "ground" }),
    line(goal, top, goal, top - 30, "ground"),
    svg("path", { d: `M${goal} ${top - 30} l 16 6 l -16 6 z`, class: "flag" }),
    svg("g", { transform: `translate(${across(x)} ${height(x)}) rotate(${slope})` },
      svg("rect", { x: -15, y: -18, width: 30, height: 12, rx: 3, class: "thing" }),
      dot(-8, -5, 5, "joint"), dot(8, -5, 5, "joint")),
  ];
}
