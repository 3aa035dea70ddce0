// Charts: the returns of test episodes, the training, and shares as bars.

const CHART = { width: 460, height: 210, left: 52, right: 14, top: 14, bottom: 40 };

/** Round numbers between two ends. */
function ticks(low, high, most = 5) {
  const span = high - low || 1;
  const power = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10].map((times) => times * power).find((size) => span / size <= most);
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) found.push(i * step);
  return found;
}

function scaled(low, high, from, to) {
  return (x) => from + ((x - low) / (high - low || 1)) * (to - from);
}

function shortNumber(x) {
  const size = Math.abs(x);
  if (size >= 1e6) return `${numberWords(x / 1e6, 3)} M`;
  return size >= 1e4 ? `${numberWords(x / 1e3, 3)} k` : numberWords(x, 3);
}

/** An empty chart: axes, ticks, names; returns its scales, too. */
function axes(xs, ys, xName, yName, summary, height = CHART.height) {
  const { width, left, right, top, bottom } = CHART;
  const x = scaled(...xs, left, width - right);
  const y = scaled(...ys, height - bottom, top);
  const chart = svg("svg", { class: "chart", viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": summary });
  for (const tick of yName === null ? [] : ticks(...ys, 4))
    chart.append(
      svg("line", { class: "grid", x1: left, x2: width - right, y1: y(tick), y2: y(tick) }),
      svg("text", { class: "tick end", x: left - 7, y: y(tick) }, shortNumber(tick)));
  for (const tick of ticks(...xs, 6))
    chart.append(
      svg("line", { class: "tick-line", x1: x(tick), x2: x(tick), y1: height - bottom, y2: height - bottom + 4 }),
      svg("text", { class: "tick", x: x(tick), y: height - bottom + 15 }, shortNumber(tick)));
  chart.append(
    svg("line", { class: "axis", x1: left, x2: width - right, y1: height - bottom, y2: height - bottom }),
    svg("text", { class: "axis-name", x: (left + width - right) / 2, y: height - 6 }, xName));
  if (yName) chart.append(svg("text", { class: "axis-name", transform: `translate(11 ${(top + height - bottom) / 2}) rotate(-90)` }, yName));
  return { chart, x, y };
}

/** How often which return came. */
function histogram({ returns, mean, words }) {
  const [low, high] = widened(Math.min(...returns), Math.max(...returns));
  const bins = Math.max(5, Math.min(24, Math.ceil(2 * Math.cbrt(returns.length)) + 4));
  const counts = new Array(bins).fill(0);
  for (const x of returns) counts[Math.min(bins - 1, Math.floor(((x - low) / (high - low)) * bins))] += 1;
  const summary = `Returns of ${returns.length} test episodes: ${words}`;
  const { chart, x, y } = axes([low, high], [0, Math.max(...counts)], "return", "episodes", summary);
  counts.forEach((count, i) => {
    const [from, to] = [x(low + ((high - low) * i) / bins), x(low + ((high - low) * (i + 1)) / bins)];
    if (count)
      chart.append(svg("rect", { class: "column", x: from + 1, y: y(count), width: to - from - 2, height: y(0) - y(count), rx: 1.5 },
        svg("title", null, `${count} of ${returns.length}`)));
  });
  chart.append(svg("line", { class: "mean", x1: x(mean), x2: x(mean), y1: CHART.top - 6, y2: y(0) }));
  return chart;
}

function widened(low, high) {
  const beyond = high > low ? 0.04 * (high - low) : Math.max(1, Math.abs(high) * 0.1);
  return [low - beyond, high + beyond];
}

/** Lines of [x, y] points, named in the order in which they are drawn. */
function curves(series, xName, yName) {
  const points = series.flatMap((one) => one.points);
  const ys = widened(Math.min(...points.map(([, y]) => y)), Math.max(...points.map(([, y]) => y)));
  const last = series.map(({ name, points: p }) => `${name} ends at ${numberWords(p.at(-1)[1])}`).join(", ");
  const { chart, x, y } = axes([0, Math.max(...points.map(([t]) => t))], ys, xName, yName, `Training: ${last}`);
  series.forEach(({ points: p }, i) => {
    const d = `M${p.map(([a, b]) => `${x(a).toFixed(1)} ${y(b).toFixed(1)}`).join("L")}`;
    chart.append(svg("path", { class: `curve series-${i}`, d }));
    if (p.length < 40) for (const [a, b] of p) chart.append(svg("circle", { class: `point series-${i}`, cx: x(a), cy: y(b), r: 2.4 }));
  });
  const names = el("p", { class: "names" }, ...series.map(({ name }, i) =>
    el("span", null, el("i", { class: `swatch series-${i}` }), name)));
  return el("div", null, chart, names);
}

/** The returns of several policies on one axis: every episode a dot, the mean a line. */
function strips(policies) {
  const all = policies.flatMap(({ tests }) => tests.returns);
  const row = 46;
  const height = policies.length * row + CHART.top + CHART.bottom;
  const summary = policies.map(({ name, tests }) => `${name}: ${tests.words}`).join("; ");
  const { chart, x } = axes(widened(Math.min(...all), Math.max(...all)), [0, 1], "return", null, summary, height);
  policies.forEach(({ name, tests }, i) => {
    const middle = CHART.top + (i + 0.62) * row;
    chart.append(svg("text", { class: "strip-name", x: CHART.left, y: middle - 19 }, shortened(name)));
    tests.returns.forEach((value, j) => {
      const aside = (((j * 0.618034) % 1) - 0.5) * 18; // spread evenly, alike each time
      chart.append(svg("circle", { class: `strip series-${i % 4}`, cx: x(value), cy: middle + aside, r: 2.6 }));
    });
    chart.append(svg("line", { class: "mean", x1: x(tests.mean), x2: x(tests.mean), y1: middle - 13, y2: middle + 13 }));
  });
  return chart;
}
