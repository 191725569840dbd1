"use strict";
// Small drawings in SVG, redrawn whole at every move: nothing is loaded, nothing is kept but the sliders' positions.
const Page = (() => {
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const data = read("data");
  const texts = read("positions");
  const space = document.querySelector("svg").namespaceURI;
  const GREY = "#767676";
  const DASHES = { "-": null, "--": "6 4", ":": "2 3", "-.": "7 3 2 3" };
  const FLAT = new Set(["x", "+"]);

  function svg(parent, name, attributes, text) {
    const made = document.createElementNS(space, name);
    for (const [key, value] of Object.entries(attributes || {})) {
      if (value !== null && value !== undefined) made.setAttribute(key, value);
    }
    if (text !== undefined) made.textContent = text;
    return parent.appendChild(made);
  }

  function html(parent, name, text, attributes) {
    const made = document.createElement(name);
    if (text !== undefined) made.textContent = text;
    for (const [key, value] of Object.entries(attributes || {})) made.setAttribute(key, value);
    return parent.appendChild(made);
  }

  const at = (value) => Math.round(value * 10) / 10;
  const closed = (corners) => "M" + corners.map(([x, y]) => `${at(x)} ${at(y)}`).join("L") + "Z";
  const open = (points) => "M" + points.map(([x, y]) => `${at(x)} ${at(y)}`).join("L");

  function star(x, y, r) {
    const around = Array.from({ length: 10 }, (_, k) => {
      const angle = -Math.PI / 2 + (k * Math.PI) / 5;
      const far = k % 2 ? 0.42 * r : r;
      return [x + far * Math.cos(angle), y + far * Math.sin(angle)];
    });
    return closed(around);
  }

  function plus(x, y, r, turn) {
    const corners = [[1, 3], [1, 1], [3, 1], [3, -1], [1, -1], [1, -3], [-1, -3], [-1, -1], [-3, -1], [-3, 1], [-1, 1], [-1, 3]];
    const [c, s] = [Math.cos(turn) * r / 3, Math.sin(turn) * r / 3];
    return closed(corners.map(([a, b]) => [x + c * a - s * b, y + s * a + c * b]));
  }

  // Matplotlib's letters, as the pictures beside the page use them.
  function shape(kind, x, y, r) {
    switch (kind) {
      case "^": return closed([[x, y - 1.15 * r], [x + r, y + 0.75 * r], [x - r, y + 0.75 * r]]);
      case "v": return closed([[x, y + 1.15 * r], [x + r, y - 0.75 * r], [x - r, y - 0.75 * r]]);
      case "<": return closed([[x - 1.15 * r, y], [x + 0.75 * r, y - r], [x + 0.75 * r, y + r]]);
      case ">": return closed([[x + 1.15 * r, y], [x - 0.75 * r, y - r], [x - 0.75 * r, y + r]]);
      case "x": return open([[x - r, y - r], [x + r, y + r]]) + open([[x - r, y + r], [x + r, y - r]]);
      case "+": return open([[x - 1.2 * r, y], [x + 1.2 * r, y]]) + open([[x, y - 1.2 * r], [x, y + 1.2 * r]]);
      case "s": return closed([[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]]);
      case "D": return closed([[x, y - 1.3 * r], [x + 1.3 * r, y], [x, y + 1.3 * r], [x - 1.3 * r, y]]);
      case "d": return closed([[x, y - 1.4 * r], [x + 0.8 * r, y], [x, y + 1.4 * r], [x - 0.8 * r, y]]);
      case "p": return closed([0, 1, 2, 3, 4].map((k) => [x + 1.15 * r * Math.sin(k * 1.2566), y - 1.15 * r * Math.cos(k * 1.2566)]));
      case "P": return plus(x, y, 1.25 * r, 0);
      case "X": return plus(x, y, 1.25 * r, Math.PI / 4);
      case "*": return star(x, y, 1.5 * r);
      default: return `M${at(x - r)} ${at(y)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`;
    }
  }

  // `filled` may be a colour of its own; marks of lines are never filled.
  function marks(parent, kind, points, r, colour, filled, faint) {
    if (!points.length) return;
    const flat = FLAT.has(kind);
    svg(parent, "path", {
      d: points.map(([x, y]) => shape(kind, x, y, r)).join(""),
      fill: flat || !filled ? "none" : filled === true ? colour : filled,
      stroke: colour,
      "stroke-width": flat ? Math.min(2, 0.45 * r) : 1.6, // a small cross with thick arms is a square
      opacity: faint ? 0.75 : null,
    });
  }

  const line = (parent, points, colour, style, width) =>
    points.length > 1 && svg(parent, "path", {
      d: open(points), fill: "none", stroke: colour, "stroke-width": width || 1.8, "stroke-dasharray": DASHES[style || "-"],
    });

  function ticks(low, high, wanted) {
    if (!(high > low)) return [low];
    const rough = (high - low) / wanted;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((each) => each * power >= rough * 0.999);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
    return found;
  }

  const short = (value) => value === null || value === undefined ? "–" : String(Number(value.toPrecision(3)));

  // On paper a figure has a width of its own, whatever the window's.
  const PAPER = { wide: 680, half: 330 };
  let isPrinting = false;
  function widthOf(id) {
    const place = document.getElementById(id);
    if (isPrinting) return place.closest(".wide") ? PAPER.wide : PAPER.half;
    return Math.max(260, place.clientWidth || 640);
  }

  function empty(id, height, label) {
    const drawing = document.querySelector(`#${id} svg`);
    const width = widthOf(id);
    drawing.replaceChildren();
    drawing.setAttribute("viewBox", `0 0 ${width} ${height}`);
    drawing.setAttribute("aria-label", label);
    return { drawing, width, height };
  }

  // Axes of a chart: `x` and `y` are [from, to]; returns how to place a point.
  function chart(id, { height, label, x, y, xLabel, yLabel, xTicks, left, yTicks }) {
    const { drawing, width } = empty(id, height, label);
    const inside = { left: left || 46, right: width - 12, top: 18, bottom: height - (xLabel ? 38 : 22) };
    const span = (from, to) => (to > from ? to - from : 1);
    const px = (value) => inside.left + ((value - x[0]) / span(...x)) * (inside.right - inside.left);
    const py = (value) => inside.bottom - ((value - y[0]) / span(...y)) * (inside.bottom - inside.top);
    for (const value of yTicks || ticks(y[0], y[1], 4)) {
      svg(drawing, "line", { x1: inside.left, x2: inside.right, y1: at(py(value)), y2: at(py(value)), stroke: "#e4e4e4" });
      svg(drawing, "text", { x: inside.left - 6, y: at(py(value)) + 4, "text-anchor": "end" }, short(value));
    }
    const along = xTicks || ticks(x[0], x[1], Math.max(2, Math.floor(width / 90))).map((value) => [value, short(value)]);
    for (const [value, text] of along) {
      svg(drawing, "line", { x1: at(px(value)), x2: at(px(value)), y1: inside.bottom, y2: inside.bottom + 4, stroke: GREY });
      // In the middle below its tick, but within the drawing.
      const x = Math.min(px(value), width - 1 - 3.8 * String(text).length);
      svg(drawing, "text", { x: at(x), y: inside.bottom + 17, "text-anchor": "middle" }, text);
    }
    svg(drawing, "line", { x1: inside.left, x2: inside.right, y1: inside.bottom, y2: inside.bottom, stroke: GREY });
    if (xLabel) svg(drawing, "text", { x: (inside.left + inside.right) / 2, y: height - 4, "text-anchor": "middle" }, xLabel);
    if (yLabel) svg(drawing, "text", { x: 2, y: 11 }, yLabel);
    return { drawing, px, py, inside, place: ([a, b]) => [px(a), py(b)] };
  }

  const cursor = ({ drawing, px, inside }, value) =>
    svg(drawing, "line", { x1: at(px(value)), x2: at(px(value)), y1: inside.top, y2: inside.bottom, stroke: "#000", "stroke-dasharray": "2 2" });

  // Entries [text, draw(svg)] or [text, look].
  function legend(id, entries) {
    const place = document.getElementById(`${id}-legend`);
    place.replaceChildren();
    for (const [text, draw] of entries) {
      const entry = html(place, "span");
      const sample = svg(entry, "svg", { viewBox: "0 0 26 14", "aria-hidden": "true" });
      draw(sample);
      entry.append(text);
    }
  }

  const sampleMark = (kind, colour, filled, style) => (parent) => {
    if (style) line(parent, [[0, 7], [26, 7]], colour, style);
    if (kind) marks(parent, kind, [[13, 7]], 4.5, colour, filled);
  };
  const sampleArea = (colour) => (parent) => svg(parent, "rect", { x: 3, y: 1, width: 20, height: 12, fill: colour });

  // Sliders: native range inputs; the address holds their positions, so that a view can be kept.
  let again = () => {};
  const MOST_CURVES = 6;

  // Which curves are drawn: all, or at first the six that matter most and all on request.
  function choice(names, first, spelled) {
    const main = new Set((first || names).slice(0, MOST_CURVES));
    let every = names.length <= MOST_CURVES;
    if (!every) {
      const row = html(document.getElementById("play").parentNode, "label", undefined, { class: "every" });
      document.querySelector(".figures").before(row);
      const box = html(row, "input", undefined, { type: "checkbox", id: "every", autocomplete: "off" });
      row.append(` draw all ${names.length}, not only ${[...main].map((name) => (spelled ? spelled[name] : name)).join(", ")}`);
      box.addEventListener("change", () => {
        every = box.checked;
        again();
      });
    }
    return (name) => every || isPrinting || main.has(name);
  }

  // A name of several parts may take two rows; names often differ at their ends, so the middle is cut.
  function inRows(name) {
    const cut = (text) => text.length > 25 ? `${text.slice(0, 11)}…${text.slice(-13)}` : text;
    const [first, ...rest] = name.length > 25 ? name.split(", ") : [name];
    return (rest.length ? [first, rest.join(", ")] : [first]).map(cut);
  }

  // The name of a row, left of the axis.
  function rowName(drawing, name, x, y) {
    const rows = inRows(name);
    rows.forEach((text, row) => svg(drawing, "text", { x, y: y + 4 + 13 * (row - (rows.length - 1) / 2), "text-anchor": "end" }, text));
  }

  function follow(redraw) {
    // What has one position has no slider: it stays at its first.
    const inputs = Object.keys(texts).map((name) => document.getElementById(name)).filter((input) => input);
    const fixed = Object.fromEntries(Object.keys(texts).map((name) => [name, 0]));
    const position = () => ({ ...fixed, ...Object.fromEntries(inputs.map((input) => [input.id, Number(input.value)])) });
    let waiting = false;
    const show = () => {
      waiting = false;
      for (const input of inputs) {
        const text = texts[input.id][Number(input.value)];
        input.setAttribute("aria-valuetext", text);
        document.getElementById(`${input.id}-value`).textContent = text;
      }
      const now = position();
      for (const part of document.querySelectorAll("[data-slider]")) {
        part.hidden = now[part.dataset.slider] !== Number(part.dataset.position);
      }
      redraw(now);
      document.documentElement.dataset.drawn = JSON.stringify(now);
    };
    const soon = () => {
      if (!waiting) {
        waiting = true;
        requestAnimationFrame(show);
      }
    };
    const fromAddress = () => {
      const asked = new URLSearchParams(location.hash.slice(1));
      for (const input of inputs) {
        const value = asked.get(input.id);
        if (value !== null && /^\d+$/.test(value)) input.value = String(Math.min(Number(value), Number(input.max)));
      }
      show();
    };
    const toAddress = () => {
      const hash = "#" + new URLSearchParams(Object.entries(position()).map(([name, value]) => [name, String(value)]));
      try {
        history.replaceState(null, "", hash);
      } catch (error) {
        // Some viewers forbid it; the page works without.
      }
    };
    for (const input of inputs) {
      input.addEventListener("input", soon);
      input.addEventListener("change", toAddress);
    }
    again = soon;
    addEventListener("resize", soon);
    addEventListener("hashchange", fromAddress);
    addEventListener("beforeprint", () => {
      document.querySelectorAll("details").forEach((part) => { part.open = true; });
      isPrinting = true;
      show();
    });
    addEventListener("afterprint", () => {
      isPrinting = false;
      show();
    });
    fromAddress();
  }

  return { data, texts, svg, html, at, closed, open, marks, line, short, widthOf, empty, chart, cursor, legend, sampleMark, sampleArea, rowName, choice, follow, GREY };
})();
