// Elements made of names, attributes and children. Strings become text and never markup.

const SVG = "http://www.w3.org/2000/svg";

function el(tag, attributes, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

function svg(tag, attributes, ...children) {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

function filled(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined && value !== false)
      element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

function button(words, onclick, attributes) {
  return el("button", { type: "button", onclick, ...attributes }, words);
}

/** A picture on a button, out of a path in a square of 16. */
function icon(d) {
  return svg("svg", { class: "icon", viewBox: "0 0 16 16", "aria-hidden": "true" }, svg("path", { d }));
}

/** A part of the page with a heading; `tools` stand at the right of it. */
function card(name, title, tools, ...children) {
  const heading = el("h2", { id: `${name}-title` }, title);
  const head = el("header", null, heading, tools && el("div", { class: "tools" }, ...tools));
  return el("section", { class: `card ${name}`, "aria-labelledby": heading.id }, head, ...children);
}

/** A number as people read it, with so many significant digits. */
function numberWords(x, digits = 4) {
  if (Number.isNaN(x)) return "NaN";
  if (!Number.isFinite(x)) return x > 0 ? "∞" : "-∞";
  if (x === 0) return "0"; // of either sign
  if (Number.isInteger(x) && Math.abs(x) < 1e6) return x.toLocaleString("en");
  const short = Number(x.toPrecision(digits));
  return Math.abs(short) >= 1e5 || Math.abs(short) < 1e-4 ? short.toExponential() : String(short);
}

/** A float32 number in the fewest digits that give it back. */
function exactWords(x) {
  if (!Number.isFinite(x)) return numberWords(x);
  for (let digits = 1; digits < 9; digits++)
    if (Math.fround(Number(x.toPrecision(digits))) === x) return String(Number(x.toPrecision(digits)));
  return String(Number(x.toPrecision(9)));
}

/** A share as people read it: 62 %. */
function shareWords(share) {
  if (share > 0 && share < 0.005) return "<1 %";
  if (share >= 0.995 && share < 1) return ">99 %";
  return `${Math.round(100 * share)} %`;
}

/** Rows of float32 numbers out of base64. */
function unpacked(text, columns) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const numbers = new Float32Array(bytes.buffer);
  const rows = [];
  for (let i = 0; i < numbers.length; i += columns) rows.push(numbers.subarray(i, i + columns));
  return rows;
}

function clipped(x, low, high) {
  return Math.min(high, Math.max(low, x));
}
