// The report of one policy.

const data = JSON.parse(document.getElementById("data").textContent);
const { policy, player: films } = data;

const treeView = new TreeView(policy, (node) => describe(node));
const nodePanel = new NodePanel(policy);
const observationPanel = new ObservationPanel(policy, (observation) => ask(observation, true));
const stage = films && new Stage(films.drawing, policy.features.length);
const player = films && new Player(films.episodes.map(({ title }) => title), films.fps, start, (step) => {
  edited.hidden = true;
  stage.show(step);
  ask(stage.observation(step), false);
  player.say(`Step ${step}: ${stage.words(step)}`);
});
const edited = el("p", { class: "edited", hidden: true }, "What if? The observation is yours. ",
  button("Back to the episode", () => player.start(stage.length), { class: "link" }));
const answer = el("p", { class: "answer", role: "status", "aria-live": "polite" });
let reached = 0;

/** Put an observation to the tree: light its way and say where it ends. */
function ask(observation, byHand) {
  const path = pathOf(policy.nodes, observation);
  reached = path.at(-1);
  treeView.show(path);
  observationPanel.show(observation, askedOn(policy.nodes, path));
  describe(null);
  if (!byHand) return;
  answer.textContent = `The tree answers: ${policy.nodes[reached].words}`;
  if (!films) return;
  player.pause();
  edited.hidden = false;
  if (films.drawing) stage.show(player.step, observation);
}

function describe(node) {
  if (node === null) nodePanel.show(reached, "reached now");
  else nodePanel.show(node, "in view");
}

function start(episode) {
  stage.episode = films.episodes[episode];
  player.start(stage.length);
}

function build() {
  const parts = [
    data.checks && checksCard(data.checks, policy.features.length, (observation) => {
      ask(observation, true);
      treeView.element.scrollIntoView({ block: "center" });
    }),
    data.tests && returnsCard(data.tests),
    data.curve && trainingCard(data.curve),
    policy.importance && policy.importance.length > 0 && importanceCard(policy.importance),
  ].filter(Boolean);
  const hint = el("p", { class: "hint quiet" }, "Click into the tree, then scroll to zoom; drag to move; arrow keys walk it.");
  const aside = [
    films && card("episode", "Episode", null, stage.element, player.element),
    card("observation", "Observation", null, edited, answer, observationPanel.element),
  ].filter(Boolean);
  document.body.append(
    pageHead(data),
    el("main", null,
      el("div", { class: "workbench" },
        el("div", { class: "left" },
          card("tree", "The policy", treeView.tools, treeView.element, legend(policy.legend), hint),
          card("node", "Why", null, nodePanel.element)),
        el("div", { class: "right" }, ...aside)),
      el("div", { class: "tiles" }, ...parts),
      rulesCard(policy),
      data.programs.length ? programsCard(data.programs) : null,
      provenanceCard(data.provenance)),
    el("footer", null, "Made by sympol. This file asks nothing of the network."));
  treeView.draw();
  treeView.fit();
  if (films) start(0);
  else ask(observationPanel.values, false);
  whenPrinted([treeView]);
  addEventListener("resize", () => treeView.resized());
}

build();
globalThis.sympol = { leafOf: (observation) => leafOf(policy.nodes, observation) };
