// The page of a backtest.
(() => {
  const { data, texts, svg, html, at, closed, marks, line, short, widthOf, empty, chart, cursor, legend, sampleMark, sampleArea, follow, GREY } = Page;
  const { regimes, makers, looks, beliefs, sets, factor, unit, followed, weights } = data;
  const hiding = makers.slice(1);
  const steps = data.dates.length;
  const isLottery = (name) => data.lotteries.includes(name);
  // An entry is [atoms [set, probability, regret, privacy], drawn, estimate of the aware observer].
  const entry = (name, step, budget) => data.played[name][name === makers[0] ? 0 : budget][step];
  const mean = (corners) => corners.length
    ? regimes.map((_, i) => corners.reduce((sum, corner) => sum + corner[i], 0) / corners.length) : null;
  const centres = sets.map(mean);
  const guess = (belief) => belief === null ? "–" : belief.map((share) => share.toFixed(2)).join(" ");
  const expected = (atoms, part) => atoms.some((atom) => atom[part] === null && atom[1] > 0)
    ? null : atoms.reduce((sum, atom) => sum + atom[1] * atom[part], 0);
  // A cross stays visible on a dot, a dot hides a cross.
  const onTop = (list, name) => [...list].sort((a, b) => (looks[name(a)].marker === "x") - (looks[name(b)].marker === "x"));
  const spelled = (name) => data.spelled[name];
  const names = (name) => (isLottery(name) ? `${spelled(name)}, drawn` : spelled(name));

  // ---- the belief simplex: a triangle for three regimes, bars for any other number
  function corner(width) {
    const side = Math.min(width - 60, 430);
    const top = [width / 2, 24];
    const high = (side * Math.sqrt(3)) / 2;
    return { points: [top, [width / 2 - side / 2, 24 + high], [width / 2 + side / 2, 24 + high]], height: high + 52 };
  }
  const triangle = (points) => (belief) => [0, 1].map((k) => belief.reduce((sum, share, i) => sum + share * points[i][k], 0));

  function nearest(point, corners) {
    if (corners.length === 1) return corners[0];
    let best = null;
    let least = Infinity;
    corners.forEach((from, k) => {
      const to = corners[(k + 1) % corners.length];
      const along = [to[0] - from[0], to[1] - from[1]];
      const length = along[0] ** 2 + along[1] ** 2;
      const share = length ? Math.max(0, Math.min(1, ((point[0] - from[0]) * along[0] + (point[1] - from[1]) * along[1]) / length)) : 0;
      const found = [from[0] + share * along[0], from[1] + share * along[1]];
      const apart = Math.hypot(found[0] - point[0], found[1] - point[1]);
      if (apart < least) [least, best] = [apart, found];
    });
    return best;
  }

  function drawSet(drawing, corners, look, faint) {
    if (corners.length === 1) return marks(drawing, look.marker, corners, look.marker === "^" ? 9 : 6, look.colour, !faint && look.marker !== "^", faint);
    if (corners.length === 2) {
      line(drawing, corners, look.colour, faint ? ":" : "-", 4);
      return marks(drawing, look.marker, corners, 4.5, look.colour, !faint && look.marker !== "^", faint);
    }
    return svg(drawing, "path", {
      d: closed(corners), fill: look.colour, "fill-opacity": faint ? 0.15 : 0.4, stroke: look.colour, "stroke-dasharray": faint ? "3 3" : null,
    });
  }

  function drawTriangle(step, budget, label) {
    const { points, height } = corner(widthOf("simplex"));
    const { drawing } = empty("simplex", Math.round(height), label);
    const place = triangle(points);
    svg(drawing, "path", { d: closed(points), fill: "none", stroke: GREY });
    for (let k = 1; k < 5; k += 1) {
      for (let i = 0; i < 3; i += 1) {
        const ends = [1, 2].map((j) => regimes.map((_, r) => (r === i ? k / 5 : r === (i + j) % 3 ? 1 - k / 5 : 0)));
        line(drawing, ends.map(place), "#e4e4e4", "-", 1);
        const [x, y] = place(ends[1]); // the sides that the pictures beside the page use
        const [across, down, side] = [[6, 4, "start"], [-6, 4, "end"], [0, 15, "middle"]][i];
        svg(drawing, "text", { x: at(x + across), y: at(y + down), "text-anchor": side, class: "tick" }, (k / 5).toFixed(1));
      }
    }
    const anchors = [["middle", 0, -10], ["start", -20, 20], ["end", 20, 20]];
    regimes.forEach((name, i) => svg(drawing, "text", {
      x: at(points[i][0] + anchors[i][1]), y: at(points[i][1] + anchors[i][2]), "text-anchor": anchors[i][0], "font-weight": 600,
    }, name));
    svg(drawing, "path", { d: beliefs.map((belief) => { const [x, y] = place(belief); return `M${at(x - 1)} ${at(y)}h2`; }).join(""), stroke: "#b5b5b5", "stroke-width": 2 });
    const star = place(beliefs[step]);
    for (const name of onTop(makers, (each) => each)) {
      const [atoms, drawn, aware] = entry(name, step, budget);
      const look = looks[name];
      atoms.forEach((atom, k) => {
        const corners = sets[atom[0]].map(place);
        if (!corners.length) return;
        const faint = k !== drawn;
        if (atom[3] !== null && Math.abs(atom[3]) > 0) line(drawing, [star, nearest(star, corners)], look.colour, faint ? ":" : "--", 1.2);
        drawSet(drawing, corners, look, faint);
        if (isLottery(name) && atoms.length > 1) {
          const [x, y] = place(centres[atom[0]]);
          const isLeft = x > points[2][0] - 30;
          svg(drawing, "text", { x: at(isLeft ? x - 9 : x + 9), y: at(y - 12), "text-anchor": isLeft ? "end" : "start", class: "clear" }, `with ${Math.round(100 * atom[1])}%`);
        }
      });
      if (aware && name !== makers[0]) {
        const [x, y] = place(aware);
        svg(drawing, "circle", { cx: at(x), cy: at(y), r: 10, fill: "none", stroke: look.colour, "stroke-width": 1.4, "stroke-dasharray": "3 2" });
        svg(drawing, "circle", { cx: at(x), cy: at(y), r: 2, fill: look.colour });
      }
    }
    marks(drawing, "*", [star], 5, "#000", true);
  }

  function drawBars(step, budget, label) {
    const row = 16 * makers.length + 26;
    const { drawing, px, inside } = chart("simplex", {
      height: row * regimes.length + 60, label, x: [0, 1], y: [0, 1], yTicks: [], xLabel: "probability of the regime",
      left: 14 + 7.5 * Math.min(14, Math.max(...regimes.map((name) => name.length))),
    });
    regimes.forEach((regime, i) => {
      const top = inside.top + i * row;
      svg(drawing, "text", { x: 2, y: top + row / 2, "font-weight": 600 }, regime);
      if (i) line(drawing, [[2, top - 4], [inside.right, top - 4]], "#e4e4e4", "-", 1);
      makers.forEach((name, m) => {
        const y = top + 20 + 16 * m;
        const [atoms, drawn, aware] = entry(name, step, budget);
        const look = looks[name];
        atoms.forEach((atom, k) => {
          const shares = sets[atom[0]].map((each) => each[i]);
          if (!shares.length) return;
          line(drawing, [[px(Math.min(...shares)), y], [px(Math.max(...shares)), y]], look.colour, k === drawn ? "-" : ":", 4);
          marks(drawing, look.marker, [[px(centres[atom[0]][i]), y]], 5, look.colour, k === drawn && look.marker !== "^", k !== drawn);
        });
        if (aware && m) svg(drawing, "circle", { cx: at(px(aware[i])), cy: y, r: 8, fill: "none", stroke: look.colour, "stroke-dasharray": "3 2" });
      });
      const x = px(beliefs[step][i]);
      line(drawing, [[x, top + 10], [x, top + row - 8]], "#000", ":", 1);
      marks(drawing, "*", [[x, top + 10]], 5, "#000", true);
    });
  }

  function drawSimplex(step, budget) {
    const label = `Belief ${guess(beliefs[step])} (${regimes.join(", ")}). ` + makers.map((name) => {
      const [atoms, drawn] = entry(name, step, budget);
      return `${names(name)} is read as ${guess(centres[atoms[drawn][0]])}`;
    }).join("; ");
    (regimes.length === 3 ? drawTriangle : drawBars)(step, budget, label);
  }

  // ---- the frontier of one decision
  function drawFrontier(step, budget) {
    const { single, mixed } = data.frontiers[step];
    const most = data.amounts[data.amounts.length - 1];
    const amount = data.amounts[budget];
    const shown = Math.min(most, Math.max(3 * amount, 0.3 * most));
    const points = [...single, ...mixed].filter(([x]) => x <= shown);
    const price = slope(mixed, amount);
    const each = unit.startsWith("%") ? unit : "unit of regret";
    const heights = points.map(([, y]) => y).concat(0, mixed.length ? height(mixed, shown) : 0);
    const frame = chart("frontier", {
      height: 330, label: `Privacy against regret. At this budget one more ${each} buys ${short(price)} of privacy.`,
      x: [0, factor * shown], y: [Math.min(...heights), Math.max(...heights, 0.01) * 1.05],
      xLabel: `regret, ${unit}`, yLabel: "privacy Ψ",
    });
    const { drawing, place } = frame;
    const scaled = (list) => list.map(([x, y]) => place([factor * Math.min(x, shown), y]));
    const stairs = [];
    single.filter(([x]) => x <= shown).forEach(([x, y], k, all) => {
      if (k) stairs.push([x, all[k - 1][1]]);
      stairs.push([x, y]);
    });
    if (stairs.length) stairs.push([shown, stairs[stairs.length - 1][1]]);
    line(drawing, scaled(stairs), looks.CDM.colour, "-");
    const envelope = mixed.filter(([x]) => x <= shown);
    if (envelope.length) envelope.push([shown, height(mixed, shown)]);
    line(drawing, scaled(envelope), looks.PDM.colour, "--");
    cursor(frame, factor * amount);
    if (amount > 0 && mixed.length) {
      // The tangent at the budget, as far as it stays within the frame.
      const reached = height(mixed, amount);
      const top = Math.max(...heights, 0.01) * 1.05;
      const ends = [0.5 * amount, Math.min(1.5 * amount, shown, price > 0 ? amount + (top - reached) / (factor * price) : shown)];
      line(drawing, ends.map((x) => place([factor * x, reached + factor * price * (x - amount)])), "#000", "-", 1);
    }
    svg(drawing, "text", { x: frame.inside.right, y: frame.inside.bottom - 10, "text-anchor": "end", class: "clear" }, `slope: ${short(price)} for one more ${each}`);
    for (const name of onTop(makers, (each) => each)) {
      const [atoms] = entry(name, step, budget);
      const look = looks[name];
      const seen = atoms.filter((atom) => atom[2] !== null && atom[3] !== null && atom[2] <= shown);
      if (isLottery(name) && atoms.length > 1) marks(drawing, look.marker, seen.map((atom) => place([factor * atom[2], atom[3]])), 5, look.colour, false);
      const [cost, privacy] = [expected(atoms, 2), expected(atoms, 3)];
      if (cost !== null && privacy !== null && cost <= shown) {
        // The middle of a lottery lies on its line, its decisions at the ends.
        marks(drawing, look.marker, [place([factor * cost, privacy])], 6, look.colour, look.marker !== "^");
      }
    }
  }

  function height(corners, x) {
    const right = corners.findIndex((each) => each[0] > x);
    if (right < 0) return corners[corners.length - 1][1];
    if (right === 0) return corners[0][1];
    const [[a, b], [c, d]] = [corners[right - 1], corners[right]];
    return b + ((x - a) / (c - a)) * (d - b);
  }

  function slope(corners, x) {
    const right = corners.findIndex((each) => each[0] > x);
    if (right < 1) return 0;
    const [[a, b], [c, d]] = [corners[right - 1], corners[right]];
    return (d - b) / (c - a) / factor;
  }

  // ---- the numbers of one decision
  // An empty table in a figure; returns how to add a row.
  function table(id, label, caption, columns) {
    const place = document.getElementById(id);
    place.replaceChildren();
    place.setAttribute("role", "region");
    place.setAttribute("tabindex", "0");
    place.setAttribute("aria-label", label);
    const made = html(place, "table");
    html(made, "caption", caption);
    const head = html(html(made, "thead"), "tr");
    for (const text of columns) html(head, "th", text, { scope: "col" });
    const body = html(made, "tbody");
    return (cells, kind) => {
      const row = html(body, "tr", undefined, kind ? { class: kind } : {});
      cells.forEach((text, k) => html(row, k ? "td" : "th", text, k ? {} : { scope: "row" }));
    };
  }

  function drawWeights(step) {
    const [assets, others, rows] = weights.steps[step];
    const row = table("weights", "Published weights of this decision", `${texts.step[step]}: % of wealth`, ["Asset", ...weights.makers.map(spelled)]);
    const labels = assets.map((asset) => weights.assets[asset]).concat(others ? [`${others} other${others > 1 ? "s" : ""}`] : []);
    labels.forEach((label, k) => row([label, ...rows.map((shares) => (shares[k] / 10).toFixed(1))], k < assets.length ? "" : "atom"));
  }

  function drawNumbers(step, budget) {
    const row = table(
      "now", "This decision in numbers", `${texts.step[step]}: belief ${guess(beliefs[step])} (${regimes.join(", ")})`,
      ["Played", `regret, ${unit}`, "privacy Ψ", "read at face value", "read by the aware observer from it alone"],
    );
    for (const name of makers) {
      const [atoms, drawn, aware] = entry(name, step, budget);
      const cost = expected(atoms, 2);
      const mixed = isLottery(name) && atoms.length > 1;
      row([
        mixed ? `${spelled(name)}, in expectation` : spelled(name), cost === null ? "–" : short(factor * cost), short(expected(atoms, 3)),
        mixed ? "" : guess(centres[atoms[drawn][0]]), mixed ? "" : guess(aware),
      ]);
      if (!mixed) continue;
      atoms.forEach((atom, k) => row([
        `probability ${atom[1].toFixed(2)}${k === drawn ? ", drawn" : ""}`, atom[2] === null ? "–" : short(factor * atom[2]), short(atom[3]),
        guess(centres[atom[0]]), k === drawn ? guess(aware) : "",
      ], "atom"));
    }
  }

  // ---- over time
  function years(width) {
    const starts = [];
    data.dates.forEach((date, t) => {
      if (!t || date.slice(0, 4) !== data.dates[t - 1].slice(0, 4)) starts.push([t, date.slice(0, 4)]);
    });
    if (starts.length > 1 && starts[1][0] < 6) starts.shift();
    const every = Math.max(1, Math.ceil(starts.length / Math.max(2, Math.floor(width / 70))));
    return starts.filter((_, k) => k % every === 0);
  }

  function timeChart(id, step, series, { yLabel, least, more }) {
    const every = series.flatMap(([, values]) => values).filter((value) => value !== null);
    const now = series.map(([name, values]) => `${name} ${short(values[step])}`).join(", ");
    const frame = chart(id, {
      height: 190, label: `${yLabel}; at ${texts.step[step]}: ${now}${more || ""}`, x: [-0.5, steps - 0.5],
      y: [Math.min(0, ...every), Math.max(least, ...every) * 1.05], xTicks: years(widthOf(id)), yLabel,
    });
    cursor(frame, step);
    return frame;
  }

  function overTime(id, step, budget, { part, scale, yLabel, least }) {
    const series = makers.map((name) => [name, data.dates.map((_, t) => {
      const value = expected(entry(name, t, budget)[0], part);
      return value === null ? null : scale * value;
    })]);
    const width = widthOf(id);
    const frame = timeChart(id, step, series, { yLabel, least });
    for (const [name, values] of onTop(series, ([name]) => name)) {
      const points = values.map((value, t) => value === null ? null : frame.place([t, value])).filter((each) => each);
      // Dots are hollow, so that a cross shows in one.
      marks(frame.drawing, looks[name].marker, points, Math.max(1.8, Math.min(4, width / steps / 4)), looks[name].colour, name !== makers[0] && looks[name].marker !== "o");
    }
  }

  function drawBeliefs(step, budget) {
    const strips = [["the investor's own belief π", beliefs]];
    for (const name of makers) {
      strips.push([`read at face value: ${names(name)}`, data.dates.map((_, t) => {
        const [atoms, drawn] = entry(name, t, budget);
        return centres[atoms[drawn][0]];
      })]);
    }
    for (const name of hiding) {
      const rows = data.dates.map((_, t) => entry(name, t, budget)[2]);
      if (rows.some((each) => each)) strips.push([`aware, from one decision: ${names(name)}`, rows]);
    }
    drawStrips("beliefs", step, strips);
  }

  // Strips [title, beliefs], one below the other: as high as the probability of the likeliest regime, in its colour.
  function drawStrips(id, step, strips) {
    const [tall, gap] = [56, 26];
    const { drawing, width } = empty(id, strips.length * (tall + gap) + 24, strips.map(([title, rows]) => `${title} at ${texts.step[step]}: ${guess(rows[step] || null)}`).join("; "));
    const px = (t) => 8 + (t / steps) * (width - 16);
    strips.forEach(([title, rows], k) => {
      const top = k * (tall + gap) + 18;
      svg(drawing, "text", { x: 8, y: top - 5 }, title);
      const y = (share) => at(top + tall * (1 - share));
      const first = rows.map((row) => (row ? row.indexOf(Math.max(...row)) : -1));
      regimes.forEach((_, i) => {
        const path = rows.map((row, t) => (first[t] === i ? `M${at(px(t))} ${y(0)}V${y(row[i])}H${at(px(t + 1))}V${y(0)}Z` : "")).join("");
        svg(drawing, "path", { d: path, fill: data.colours[i], stroke: data.colours[i], "stroke-width": 0.3 });
      });
      svg(drawing, "rect", { x: 8, y: top, width: width - 16, height: tall, fill: "none", stroke: GREY, "stroke-width": 0.5 });
      const x = at(px(step + 0.5));
      svg(drawing, "line", { x1: x, x2: x, y1: top - 3, y2: top + tall + 3, stroke: "#000", "stroke-width": 1.4 });
    });
    const foot = strips.length * (tall + gap) + 12;
    for (const [t, year] of years(width)) svg(drawing, "text", { x: at(px(t)), y: foot, "text-anchor": px(t) > 24 ? "middle" : "start" }, year);
  }

  // ---- the aware observer who follows every decision, at the backtest's own budget
  function drawFollowed(step) {
    const held = Object.entries(followed.beliefs).map(([name, rows]) => [`from the weights: ${spelled(name)}`, rows]);
    drawStrips("followed", step, [["the investor's own belief π", beliefs], ...held]);
  }

  function drawLines(id, step, values, { levels, ceilings, ...rest }) {
    const series = Object.entries(values);
    const frame = timeChart(id, step, series, rest);
    const level = (from, height, colour, style) => line(frame.drawing, [from, steps - 0.5].map((t) => frame.place([t, height])), colour, style, 1.2);
    // Ceilings bound errors in the long run, not those of the first steps.
    for (const [name, height] of Object.entries(ceilings)) level(steps / 2, height, looks[name].colour, "--");
    for (const [, height, colour, style] of levels) level(-0.5, height, colour, style);
    const apart = Math.ceil(steps / 8);
    for (const [name, heights] of onTop(series, ([name]) => name)) {
      const points = heights.map((value, t) => frame.place([t, value]));
      line(frame.drawing, points, looks[name].colour, looks[name].line);
      marks(frame.drawing, looks[name].marker, points.filter((_, t) => t % apart === 0), 3.5, looks[name].colour, name !== makers[0]);
    }
    legend(id, [
      ...series.map(([name, heights]) => [
        `${spelled(name)} ${short(heights[step])}${name in ceilings ? `, ceiling ${short(ceilings[name])}` : ""}`,
        sampleMark(looks[name].marker, looks[name].colour, name !== makers[0], looks[name].line),
      ]),
      ...levels.map(([text, height, colour, style]) => [`${text} ${short(height)}`, sampleMark(null, colour, false, style)]),
    ]);
  }

  function drawBits(step) {
    drawLines("bits", step, followed.bits, { yLabel: "bits leaked so far", least: 0.01, levels: [], ceilings: {} });
  }

  function drawErrors(step) {
    const { errors, ceilings, without, asked } = followed;
    const levels = [["without any weights", without, GREY, "-."], ["a protection leaves at least", asked, "#000", ":"]];
    const told = [...Object.entries(ceilings).map(([name, height]) => [`ceiling of the ${name}`, height]), ...levels];
    drawLines("errors", step, errors, {
      yLabel: "error so far", least: Math.max(...told.map(([, height]) => height)), levels, ceilings,
      more: told.map(([text, height]) => `; ${text} ${short(height)}`).join(""),
    });
  }

  // ---- every budget
  function drawSweep(budget) {
    const curves = hiding.flatMap((name) => ["naive", "aware"].map((who) => [name, who, data.sweep[name][who]]));
    const every = curves.flatMap(([, , values]) => values).filter((value) => value !== null);
    const now = curves.map(([name, who, values]) => `${name}, ${who}: ${short(values[budget])}`).join("; ");
    const frame = chart("sweep", {
      height: 240, label: `Error of the estimate at ${texts.budget[budget]}: ${now}`, x: [0, factor * data.amounts[data.amounts.length - 1]],
      y: [0, Math.max(0.01, ...every) * 1.05], xLabel: `budget, ${unit}`, yLabel: "error of the estimate",
    });
    cursor(frame, factor * data.amounts[budget]);
    for (const [name, who, values] of curves) {
      const look = looks[name];
      const points = values.map((value, b) => value === null ? null : frame.place([factor * data.amounts[b], value])).filter((each) => each);
      line(frame.drawing, points, look.colour, who === "naive" ? "-" : ":");
      marks(frame.drawing, look.marker, points, 4, look.colour, who === "naive" ? true : "#fff");
    }
  }

  function legends() {
    const maker = (name) => [names(name), sampleMark(looks[name].marker, looks[name].colour, name !== makers[0])];
    legend("simplex", [["belief π", sampleMark("*", "#000", true)], ...makers.map(maker)]);
    legend("frontier", [["best single decision", sampleMark(null, looks.CDM.colour, false, "-")], ["best lottery", sampleMark(null, looks.PDM.colour, false, "--")], ["its slope at the budget", sampleMark(null, "#000", false, "-")], ...makers.map((name) => [spelled(name), maker(name)[1]])]);
    for (const id of ["privacy", "cost"]) legend(id, makers.map((name) => [spelled(name), maker(name)[1]]));
    for (const id of followed ? ["beliefs", "followed"] : ["beliefs"]) legend(id, regimes.map((name, i) => [name, sampleArea(data.colours[i])]));
    legend("sweep", hiding.flatMap((name) => [
      [`${spelled(name)}, at face value`, sampleMark(looks[name].marker, looks[name].colour, true, "-")],
      [`${spelled(name)}, aware`, sampleMark(looks[name].marker, looks[name].colour, "#fff", ":")],
    ]));
  }

  legends();
  follow(({ step, budget }) => {
    drawSimplex(step, budget);
    drawFrontier(step, budget);
    drawNumbers(step, budget);
    drawWeights(step);
    overTime("privacy", step, budget, { part: 3, scale: 1, yLabel: "privacy Ψ", least: 0.01 });
    overTime("cost", step, budget, { part: 2, scale: factor, yLabel: `regret, ${unit}`, least: factor * data.amounts[1] });
    drawBeliefs(step, budget);
    if (followed) for (const draw of [drawFollowed, drawBits, drawErrors]) draw(step);
    drawSweep(budget);
  });
})();
