// The page of a comparison.
(() => {
  const { data, texts, svg, at, marks, line, short, chart, cursor, legend, sampleMark, rowName, choice, follow, GREY } = Page;
  const { makers, looks, rows, spelled } = data;
  const value = (row, seen) => (seen === null ? row.naive : row.aware[seen]);
  const all = makers.flatMap((name) => rows[name]);
  const widest = Math.max(...all.map((row) => row.regret), ...data.budgets, 0) || 1;
  const highest = Math.max(data.prior, ...all.flatMap((row) => [row.naive, ...row.aware])) * 1.05;

  const isDrawn = choice(makers, data.main, spelled);

  function errors(id, budget, seen) {
    const frame = chart(id, {
      height: 340, label: `Error of the estimate against the expected regret; without decisions it is ${short(data.prior)}`,
      x: [0, 1.03 * widest], y: [0, highest], xLabel: `expected regret, ${data.unit}`, yLabel: "error of the estimate, root mean square",
    });
    const { drawing, place, inside, py } = frame;
    svg(drawing, "line", { x1: inside.left, x2: inside.right, y1: at(py(data.prior)), y2: at(py(data.prior)), stroke: "#000", "stroke-dasharray": "6 4" });
    if (seen === texts.seen.length - 1) line(drawing, data.ceilings.map(place), "#000", ":");
    cursor(frame, data.budgets[budget]);
    // A cross stays visible on any other mark: crosses are drawn last.
    const isCross = (name) => ["x", "+"].includes(looks[name].marker);
    for (const name of makers.filter(isDrawn).sort((a, b) => isCross(a) - isCross(b))) {
      const look = looks[name];
      line(drawing, rows[name].map((row) => place([row.regret, value(row, seen)])), look.colour, look.line);
      if (seen !== null) {
        for (const row of rows[name].filter((each) => each.se[seen] > 0)) {
          line(drawing, [-1.96, 1.96].map((side) => place([row.regret, row.aware[seen] + side * row.se[seen]])), look.colour, "-", 1);
        }
      }
      marks(drawing, look.marker, rows[name].map((row) => place([row.regret, value(row, seen)])), 4.5, look.colour, "#fff");
    }
  }

  function both(budget, seen) {
    const shown = makers.map((name) => [name, rows[name].find((row) => row.budget === budget) || (rows[name].length === 1 ? rows[name][0] : null)]).filter(([, row]) => row);
    const most = seen === texts.seen.length - 1 ? data.ceilings.find(([regret]) => regret === data.budgets[budget]) : undefined;
    const { drawing, px, inside } = chart("both", {
      height: 26 * shown.length + 58, left: 168, x: [0, highest], y: [0, 1], yTicks: [], xLabel: "error of the estimate",
      label: shown.map(([name, row]) => `${spelled[name]}: naive ${short(row.naive)}, aware after ${texts.seen[seen]} ${short(row.aware[seen])}`).join("; "),
    });
    svg(drawing, "line", { x1: at(px(data.prior)), x2: at(px(data.prior)), y1: inside.top, y2: inside.bottom, stroke: "#000", "stroke-dasharray": "6 4" });
    if (most) line(drawing, [[px(most[1]), inside.top], [px(most[1]), inside.bottom]], "#000", ":");
    shown.forEach(([name, row], k) => {
      const y = inside.top + 14 + 26 * k;
      const look = looks[name];
      rowName(drawing, spelled[name], inside.left - 10, y);
      line(drawing, [[px(row.aware[seen]), y], [px(row.naive), y]], GREY, "-", 1);
      marks(drawing, look.marker, [[px(row.naive), y]], 5, look.colour, true);
      svg(drawing, "circle", { cx: at(px(row.aware[seen])), cy: y, r: 6, fill: "#fff", stroke: look.colour, "stroke-width": 2 });
    });
  }

  const alone = ["without decisions", sampleMark(null, "#000", false, "--")];
  const ceiling = ["upper bound of any rule on the candidates, over time", sampleMark(null, "#000", false, ":")];
  legend("both", [
    ["naive observer: takes one decision at face value", sampleMark("s", "#000", true)],
    ["aware observer: knows the rule and the prior", sampleMark("o", "#000", "#fff")],
    alone, ...(data.ceilings.length ? [ceiling] : []),
  ]);
  follow(({ budget, seen }) => {
    const entries = makers.filter(isDrawn).map((name) => [spelled[name], sampleMark(looks[name].marker, looks[name].colour, "#fff", looks[name].line)]);
    legend("naive", [...entries, alone]);
    legend("aware", [...entries, alone, ...(data.ceilings.length ? [ceiling] : [])]);
    errors("naive", budget, null);
    errors("aware", budget, seen);
    both(budget, seen);
  });
})();
