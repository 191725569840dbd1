// The page of a study.
(() => {
  const { data, texts, svg, at, marks, line, short, chart, legend, sampleMark, rowName, choice, follow, GREY } = Page;
  const { makers, spelled, looks, budgets, figures, errors, plays, cells } = data;
  const MEAN = 0, HALF = 1, LEAST = 2;
  const paid = (setting, play) => (data.cost === null ? (plays[play][1] === null ? 0 : budgets[plays[play][1]]) : cells[setting][play][data.cost][MEAN]);
  const ends = ([mean, half]) => (half === null ? [mean, mean] : [mean - half, mean + half]);

  function range(values, zero) {
    const known = values.filter((each) => each !== null);
    const low = Math.min(...known, ...(zero ? [0] : []));
    const high = Math.max(...known, ...(zero ? [0] : []));
    return low < high ? [low, high + 0.05 * (high - low)] : [Math.min(low, 0), high > 0 ? high * 1.05 : 1];
  }

  // Budgets that span powers of ten: even steps per power, and zero in its place.
  function stretch(values) {
    const most = Math.max(...values, 0);
    const above = values.filter((each) => each > 1e-4 * most);
    const least = Math.min(...above);
    if (above.length < 2 || most < 20 * least) return { to: (value) => value, ticks: null };
    const to = (value) => Math.log10(1 + Math.max(value, 0) / least);
    const steps = [0];
    for (let power = 10 ** Math.floor(Math.log10(least)); power <= most; power *= 10) {
      steps.push(...[power, 3 * power].filter((value) => value >= 0.7 * least && value <= most));
    }
    return { to, ticks: steps.map((value) => [to(value), short(value)]) };
  }

  const nothing = (drawing, { left, right, top, bottom }) =>
    svg(drawing, "text", { x: (left + right) / 2, y: (top + bottom) / 2, "text-anchor": "middle" }, "No task has this figure here.");

  const isLeftOf = (a, b) => a[0] - b[0];

  function tradeoff(figure, budget, setting) {
    const here = cells[setting].map((play) => play[figure]);
    const known = here.flatMap((each) => [each[LEAST], each[LEAST + 4]]);
    const across = plays.map((_, play) => paid(setting, play));
    const scale = stretch(across.filter((value, play) => value !== null && here[play][MEAN] !== null));
    const prior = errors[figure] && data.prior[figure] !== null ? cells[setting].map((play) => play[data.prior[figure]][MEAN]).find((each) => each !== null) : undefined;
    const { drawing, place, inside, px, py } = chart("tradeoff", {
      height: 340, xLabel: data.paid, yLabel: figures[figure], xTicks: scale.ticks, left: 56,
      label: `${figures[figure]} against ${data.paid}` + (prior === undefined ? "" : `; without a decision ${short(prior)}`),
      x: range(across.filter((each) => each !== null).map(scale.to), true), y: range(prior === undefined ? known : [...known, prior], true),
    });
    if (here.every((each) => each[MEAN] === null)) nothing(drawing, inside);
    const kept = (y) => Math.min(Math.max(y, inside.top), inside.bottom);
    if (prior !== undefined) svg(drawing, "line", { x1: inside.left, x2: inside.right, y1: at(py(prior)), y2: at(py(prior)), stroke: "#000", "stroke-dasharray": "6 4" });
    makers.forEach((name, maker) => {
      if (!isDrawn(name)) return;
      const look = looks[name];
      const found = plays.map(([owner, amount], play) => [across[play], here[play], amount, owner])
        .filter(([x, cell, , owner]) => owner === maker && x !== null && cell[MEAN] !== null).sort(isLeftOf);
      const point = ([x, cell]) => place([scale.to(x), cell[MEAN]]);
      line(drawing, found.map(point), look.colour, look.line);
      for (const [x, cell] of found) line(drawing, ends(cell).map((end) => [px(scale.to(x)), kept(py(end))]), look.colour, "-", 1);
      marks(drawing, look.marker, found.filter((each) => each[2] !== budget).map(point), 4.5, look.colour, "#fff");
      marks(drawing, look.marker, found.filter((each) => each[2] === budget).map(point), 6, look.colour, true);
    });
  }

  function spread(figure, budget, setting) {
    const shown = plays.map(([maker, amount], play) => [makers[maker], amount, cells[setting][play][figure]])
      .filter(([, amount, cell]) => (amount === null || amount === budget) && cell[LEAST] !== null);
    const all = shown.flatMap(([, , cell]) => cell.slice(LEAST));
    const { drawing, px, inside } = chart("spread", {
      height: 30 * Math.max(1, shown.length) + 58, left: 168, x: range(all, true), y: [0, 1], yTicks: [], xLabel: figures[figure],
      label: shown.map(([name, , cell]) => `${name}: mean ${short(cell[MEAN])}, median ${short(cell[LEAST + 2])}, from ${short(cell[LEAST])} to ${short(cell[LEAST + 4])}`).join("; ") || "nothing yet",
    });
    if (!shown.length) nothing(drawing, inside);
    shown.forEach(([name, , cell], k) => {
      const y = inside.top + 16 + 30 * k;
      const look = looks[name];
      const [least, low, middle, high, most] = cell.slice(LEAST).map(px);
      rowName(drawing, spelled[name], inside.left - 10, y);
      line(drawing, [[least, y], [most, y]], GREY, "-", 1);
      svg(drawing, "rect", { x: at(low), y: y - 7, width: at(Math.max(high - low, 0)), height: 14, fill: "#fff", stroke: look.colour, "stroke-width": 1.5 });
      line(drawing, [[middle, y - 7], [middle, y + 7]], look.colour, "-", 2.5);
      if (cell[MEAN] !== null) marks(drawing, look.marker, [[px(cell[MEAN]), y]], 4.5, look.colour, true);
    });
  }

  // Over swept keys: one figure a facet, all on the same scale.
  function swept(figure, budget) {
    const { axis, values, ticks, looks: curveLooks, facets } = data.sweep;
    const playOf = (name) => plays.findIndex(([maker, amount]) => makers[maker] === name && (amount === null || amount === budget));
    const curves = facets.map((facet) => facet.map(([name, maker, settings]) => {
      const play = playOf(maker);
      const found = settings.map((setting, k) => (setting === null || play < 0 ? null : [values[k], cells[setting][play][figure]]));
      return [name, found.filter((each) => each !== null && each[1][MEAN] !== null)];
    }));
    const scale = ticks ? { to: (value) => value, ticks } : stretch(values);
    const heights = curves.flat().flatMap(([, found]) => found.flatMap(([, cell]) => ends(cell)));
    const across = values.map(scale.to);
    const margin = 0.04 * (Math.max(...across) - Math.min(...across));
    const xs = [Math.min(...across) - margin, Math.max(...across) + margin];
    curves.forEach((facet, k) => {
      const id = `swept${String.fromCharCode(65 + k)}`;
      const told = (found) => found.map(([x, cell]) => `${ticks ? ticks[x][1] : short(x)}: ${short(cell[MEAN])}`).join(", ");
      const { drawing, place, px, py, inside } = chart(id, {
        height: 300, xLabel: axis, yLabel: figures[figure], xTicks: scale.ticks, left: 56, x: xs, y: heights.length ? range(heights, true) : [0, 1],
        label: facet.map(([name, found]) => `${name}: ${told(found) || "nothing"}`).join("; "),
      });
      if (facet.every(([, found]) => !found.length)) nothing(drawing, inside);
      for (const [name, found] of facet) {
        const look = curveLooks[name];
        const point = ([x, cell]) => place([scale.to(x), cell[MEAN]]);
        line(drawing, found.map(point), look.colour, look.line);
        for (const [x, cell] of found.filter((each) => each[1][HALF] !== null)) {
          line(drawing, ends(cell).map((end) => [px(scale.to(x)), py(end)]), look.colour, "-", 1);
        }
        marks(drawing, look.marker, found.map(point), 4.5, look.colour, "#fff");
      }
      legend(id, facet.map(([name]) => [spelled[name] || name, sampleMark(curveLooks[name].marker, curveLooks[name].colour, "#fff", curveLooks[name].line)]));
    });
  }

  const isDrawn = choice(makers, data.main, spelled);
  follow(({ figure = 0, budget = 0, setting = 0 }) => {
    legend("tradeoff", makers.filter(isDrawn).map((name) => [spelled[name], sampleMark(looks[name].marker, looks[name].colour, "#fff", looks[name].line)]));
    tradeoff(figure, budget, setting);
    spread(figure, budget, setting);
    if (data.sweep) swept(figure, budget);
  });
})();
