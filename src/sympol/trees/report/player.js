// Episodes: a stage shows one at a step, a player moves one stage or several in step.

const SPEEDS = [0.25, 0.5, 1, 2, 4];
const ICONS = {
  play: "M4 2.5 L13.5 8 L4 13.5 Z",
  pause: "M3.5 2.5 h3.2 v11 h-3.2 Z M9.3 2.5 h3.2 v11 h-3.2 Z",
  back: "M3 3 h2 v10 h-2 Z M13 3 v10 L6 8 Z",
  forward: "M11 3 h2 v10 h-2 Z M3 3 L10 8 L3 13 Z",
};

/** What an episode looks like, and what is done in it. */
class Stage {
  constructor(drawing, columns) {
    Object.assign(this, { drawing, columns });
    this.picture = el("div", { class: "picture" });
    this.caption = el("p", { class: "caption" });
    this.element = el("div", { class: "stage" }, this.picture, this.caption);
    this.image = el("img", { alt: "", decoding: "sync", draggable: "false" });
  }

  set episode(episode) {
    this.shown = episode;
    this.observations = unpacked(episode.observations, this.columns);
  }

  get length() {
    return this.shown.length;
  }

  observation(step) {
    return this.observations[Math.min(step, this.observations.length - 1)];
  }

  /** What is said of a step. */
  words(step) {
    const { said, says, end, length } = this.shown;
    return step < length ? said[says[step]] : `${end} after ${length} steps`;
  }

  show(step, observation = this.observation(step)) {
    const at = Math.min(step, this.length);
    if (this.drawing) this.picture.replaceChildren(drawn(this.drawing, observation));
    else if (this.shown.frames) this.#frame(at);
    else this.picture.replaceChildren(el("p", { class: "quiet" }, "This environment draws no pictures."));
    const earned = this.shown.earned[at];
    this.caption.replaceChildren(
      el("strong", null, this.words(at)),
      el("span", null, `return ${numberWords(earned, 4)}`));
  }

  #frame(step) {
    const { images, at } = this.shown.frames;
    this.image.src = images[at[step]];
    if (!this.image.isConnected) this.picture.replaceChildren(this.image);
  }
}

class Player {
  /** `titles` are of the episodes; `onstep(step)` is told where the player is; `onepisode(i)` which it plays. */
  constructor(titles, fps, onepisode, onstep) {
    Object.assign(this, { fps, onstep, step: 0, length: 0, playing: false, speed: 1 });
    this.playButton = button(icon(ICONS.play), () => this.toggle(), { class: "play", "aria-label": "Play" });
    this.scrubber = el("input", {
      type: "range", class: "scrubber", min: 0, value: 0, "aria-label": "Step of the episode",
      oninput: () => this.#by(Number(this.scrubber.value) - this.step),
    });
    this.counter = el("output", { class: "counter" });
    this.live = el("p", { class: "unseen", role: "status", "aria-live": "polite" });
    const speed = el("select", { "aria-label": "Speed", onchange: () => (this.speed = SPEEDS[speed.selectedIndex]) },
      ...SPEEDS.map((x) => el("option", { selected: x === 1 }, `${x}×`)));
    const episode = el("select", { "aria-label": "Episode", class: "episodes", onchange: () => onepisode(episode.selectedIndex) },
      ...titles.map((title) => el("option", null, title)));
    this.element = el("div", { class: "player", role: "group", "aria-label": "Episode player", onkeydown: (event) => this.#key(event) },
      el("div", { class: "controls" },
        button(icon(ICONS.back), () => this.#by(-1), { "aria-label": "Step back", title: "Step back (←)" }),
        this.playButton,
        button(icon(ICONS.forward), () => this.#by(1), { "aria-label": "Step forward", title: "Step forward (→)" }),
        this.scrubber, this.counter, speed),
      titles.length > 1 ? episode : null,
      this.live);
  }

  /** Begin an episode of so many steps. */
  start(length) {
    this.pause();
    Object.assign(this, { length, step: 0 });
    this.scrubber.max = length;
    this.#tell();
  }

  toggle() {
    if (this.playing) return this.pause();
    if (this.step >= this.length) this.step = 0;
    this.playing = true;
    this.#sign();
    this.began = null;
    requestAnimationFrame((now) => this.#tick(now));
  }

  pause() {
    this.playing = false;
    this.#sign();
  }

  /** Say to those who do not see it what is done. */
  say(words) {
    if (!this.playing) this.live.textContent = words;
  }

  #sign() {
    this.playButton.replaceChildren(icon(this.playing ? ICONS.pause : ICONS.play));
    this.playButton.setAttribute("aria-label", this.playing ? "Pause" : "Play");
  }

  #tick(now) {
    if (!this.playing) return;
    this.began ??= { now, step: this.step, speed: this.speed };
    if (this.began.speed !== this.speed) this.began = { now, step: this.step, speed: this.speed };
    const step = this.began.step + Math.floor(((now - this.began.now) / 1000) * this.fps * this.speed);
    if (step !== this.step) {
      this.step = Math.min(step, this.length);
      this.#tell();
    }
    if (this.step >= this.length) return this.pause();
    requestAnimationFrame((then) => this.#tick(then));
  }

  #by(steps) {
    this.pause();
    this.step = clipped(this.step + steps, 0, this.length);
    this.#tell();
  }

  #tell() {
    this.scrubber.value = this.step;
    const words = `${this.step} / ${this.length}`;
    this.counter.textContent = words;
    this.scrubber.setAttribute("aria-valuetext", `step ${this.step} of ${this.length}`);
    this.onstep(this.step);
  }

  #key(event) {
    const keys = {
      ArrowLeft: () => this.#by(-1),
      ArrowRight: () => this.#by(1),
      Home: () => this.#by(-this.length),
      End: () => this.#by(this.length),
      " ": () => this.toggle(),
    };
    const own = event.target.closest("select, button") && event.key === " ";
    if (own || event.target.closest("select") || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  }
}
