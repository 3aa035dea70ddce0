// Several policies on the same episodes, moved in step.

const data = JSON.parse(document.getElementById("data").textContent);
const { policies, player: films } = data;

const lanes = policies.map((one) => new Lane(one, films.drawing, data.columns));
const player = new Player(films.titles, films.fps, start, (step) => {
  lanes.forEach((lane) => lane.show(step));
  player.say(`Step ${step}. ${lanes.map((lane) => `${lane.name}: ${lane.stage.words(step)}`).join(". ")}`);
});

function start(episode) {
  lanes.forEach((lane) => lane.start(episode));
  player.start(Math.max(...lanes.map(({ stage }) => stage.length)));
}

function numbersCard() {
  const names = ["policy", "kind", "return", "steps an episode", "nodes", "depth", "parameters"];
  const rows = policies.map(({ name, kind, tests, size }) => {
    const cells = [kind, tests.words, numberWords(tests.steps), ...[size.nodes, size.depth, size.parameters].map(counted)];
    return el("tr", null, el("th", { scope: "row" }, name), ...cells.map((words) => el("td", null, words)));
  });
  const head = el("tr", null, ...names.map((name) => el("th", { scope: "col" }, name)));
  return card("summary", "In numbers", null,
    el("div", { class: "scroll" }, el("table", { class: "numbers" }, el("thead", null, head), el("tbody", null, ...rows))));
}

function counted(n) {
  return n === null ? "–" : n.toLocaleString("en");
}

function build() {
  document.body.append(
    pageHead(data),
    el("main", null,
      card("episode", "Side by side", null, player.element,
        el("div", { class: "players" }, ...lanes.map(({ element }) => element))),
      numbersCard(),
      card("returns", "Test episodes", null, el("p", { class: "quiet" }, "Every dot an episode, the line their mean."), strips(policies))),
    el("footer", null, "Made by sympol. This file asks nothing of the network."));
  lanes.forEach((lane) => lane.draw());
  start(0);
  const trees = lanes.map(({ tree }) => tree).filter(Boolean);
  whenPrinted(trees);
  addEventListener("resize", () => trees.forEach((tree) => tree.resized()));
}

build();
