// Moving and zooming a drawing: wheel, drag, pinch, buttons.

const CLOSEST = 3;
const FURTHEST = 0.05;
const A_DRAG = 5; // pixels; less is a click

class Zoom {
  /** Moves `drawing`, a group in the SVG element `window_`. */
  constructor(window_, drawing) {
    this.window = window_;
    this.drawing = drawing;
    this.place = { x: 0, y: 0, scale: 1 };
    this.pointers = new Map();
    this.dragged = false;
    window_.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    window_.addEventListener("pointerdown", (event) => this.#down(event));
    window_.addEventListener("pointermove", (event) => this.#move(event));
    for (const end of ["pointerup", "pointercancel"])
      window_.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    // what ends a drag is no click on what lies there
    window_.addEventListener("click", (event) => this.dragged && event.stopPropagation(), true);
  }

  set(x, y, scale) {
    this.place = { x, y, scale };
    this.drawing.setAttribute("transform", `translate(${x} ${y}) scale(${scale})`);
  }

  /** Show all of a drawing of this size; one too small to read is shown from its root. */
  fit(width, height, readable) {
    const { clientWidth, clientHeight } = this.window;
    const margin = 18;
    const whole = Math.min((clientWidth - 2 * margin) / width, (clientHeight - 2 * margin) / height, 1.25);
    const scale = Math.max(whole, readable);
    const x = width * scale <= clientWidth ? (clientWidth - width * scale) / 2 : null;
    const y = height * scale <= clientHeight ? (clientHeight - height * scale) / 2 : null;
    return { scale, x, y, margin };
  }

  /** Zoom around a point of the window, its middle by default. */
  by(factor, x = this.window.clientWidth / 2, y = this.window.clientHeight / 2) {
    const scale = clipped(this.place.scale * factor, FURTHEST, CLOSEST);
    const ratio = scale / this.place.scale;
    this.set(x - (x - this.place.x) * ratio, y - (y - this.place.y) * ratio, scale);
  }

  #wheel(event) {
    // a page that scrolls must not be caught: first one clicks into the tree, or holds Ctrl
    if (!event.ctrlKey && !event.metaKey && !this.window.matches(":focus-within")) return;
    event.preventDefault();
    const corner = this.window.getBoundingClientRect();
    const speed = event.ctrlKey ? 0.01 : 0.0015;
    this.by(Math.exp(-event.deltaY * speed), event.clientX - corner.left, event.clientY - corner.top);
  }

  #down(event) {
    if (this.pointers.size === 0) this.dragged = false;
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  #move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY };
    const far = Math.hypot(now.x - before.x, now.y - before.y) >= A_DRAG;
    if (!this.dragged && !far) return;
    if (!this.dragged) this.window.setPointerCapture(event.pointerId);
    this.dragged = true;
    if (this.pointers.size === 2) this.#pinch(event.pointerId, before, now);
    else this.set(this.place.x + now.x - before.x, this.place.y + now.y - before.y, this.place.scale);
    this.pointers.set(event.pointerId, now);
  }

  #pinch(moving, before, now) {
    const [other] = [...this.pointers].filter(([id]) => id !== moving).map(([, place]) => place);
    const apart = (place) => Math.hypot(place.x - other.x, place.y - other.y);
    const corner = this.window.getBoundingClientRect();
    this.by(apart(now) / Math.max(1, apart(before)), other.x - corner.left, other.y - corner.top);
  }
}
