// The pictures that zoom. Each figure with numbers gets charts, one for each of its panels, in
// place of its drawn picture, which stays for paper and where no script runs.
"use strict";
(() => {
  const { charted, shown, DRAG_PX, NONE } = yawidCharts, pictures = [];
  const LEAST_PX = 64, AXIS_PX = 38, HINT = "drag: zoom · double click: all";
  const everyChart = () => pictures.flatMap(each => each.panels.map(({ chart }) => chart));

  // Numbers come as a unit and its multiples, or as 0 and plain numbers; instants as steps.
  const values = ([unit, ...all]) => all.map(x => (x === null || !unit ? x : x * unit));
  function instants([unit, ...all]) {
    let sum = 0;
    return unit ? all.map(step => (sum += step) * unit) : all;
  }

  function element(kind, parent, text = "") {
    const made = document.createElement(kind);
    made.textContent = text;
    parent.append(made);
    return made;
  }

  // Pictures over the same axis zoom together.
  const alike = picture => pictures.filter(each => each.label === picture.label);

  function setRange(picture, range) {
    picture.range = range;
    picture.box.setAttribute("aria-label", `${picture.label}, ${range.map(shown).join(" to ")}`);
    for (const { chart, overview } of picture.panels) {
      chart.setCursor({ left: -10, top: -10 }, false);  // what it pointed at is elsewhere now
      if (overview) chart.redraw(false);
      else chart.setScale("x", { min: range[0], max: range[1] });
    }
    const changed = ({ y, home }) => y !== home.y || range !== picture.home;
    picture.all.hidden = !picture.panels.some(changed);
  }

  function setHeight(panel, [min, max]) {
    panel.y = min === panel.home.y[0] ? panel.home.y : [min, max];
    panel.chart.setScale("y", { min, max });
  }

  // Another picture shows what it has of the range, and all of its own where that lies within it.
  function zoom(picture, from, to) {
    for (const each of alike(picture)) {
      const low = Math.max(from, each.first), high = Math.min(to, each.last);
      const all = low >= high || (from <= each.home[0] && to >= each.home[1]);
      setRange(each, each === picture ? [from, to] : all ? each.home : [low, high]);
    }
  }

  function reset(picture) {
    for (const each of alike(picture)) {
      for (const panel of each.panels) setHeight(panel, panel.home.y);
      setRange(each, each.home);
    }
  }

  // Whether a range is wide enough to be shown: numbers have only so many digits.
  const isWide = (range, home) => range[1] - range[0] > 1e-5 * (home[1] - home[0]);

  function selected(chart, panel) {
    const { left, top, width, height } = chart.select, { clientWidth, clientHeight } = chart.over;
    const ends = [left, left + width].map(x => chart.posToVal(x, "x"));
    const heights = [top + height, top].map(y => chart.posToVal(y, "y"));
    chart.setSelect(NONE, false);
    const high = height > DRAG_PX && height < clientHeight - 1 && !panel.overview;
    if (high && isWide(heights, panel.home.y)) setHeight(panel, heights);
    const across = width > DRAG_PX && width < clientWidth - 1;
    if (across && isWide(ends, panel.picture.home)) zoom(panel.picture, ...ends);
    else setRange(panel.picture, panel.picture.range);
  }

  function nearest(line, x) {
    const after = line.x.findIndex(each => each > x), high = after < 0 ? line.x.length - 1 : after;
    const low = Math.max(high - 1, 0);
    const at = line.steps || x - line.x[low] < line.x[high] - x ? low : high;
    return { away: Math.abs(line.x[at] - x), y: line.y[at] };
  }

  // Show the cursor and the values at it in all pictures over this axis.
  function follow(chart, panel) {
    const x = chart.cursor.left < 0 ? NaN : chart.posToVal(chart.cursor.left, "x");
    for (const picture of alike(panel.picture)) {
      picture.hint.textContent = isNaN(x) ? HINT : `${picture.label}: ${shown(x)}`;
      for (const each of picture.panels) {
        const { min, max } = each.chart.scales.x, inside = x >= min && x <= max;
        for (const { lines, value } of each.entries) {
          const found = inside ? lines.map(line => nearest(line, x)) : [];
          const [best] = found.sort((a, b) => a.away - b.away);
          const known = best && best.y !== null && best.away < (max - min) / 50;
          value.textContent = known ? ` ${shown(best.y)}` : "";
        }
        const left = inside ? each.chart.valToPos(x, "x") : -10;
        if (each.chart !== chart) each.chart.setCursor({ left, top: -10 }, false);
      }
    }
  }

  // Write what a panel has above it: its axis, and the names of its lines, whose values follow.
  function headed(panel, box) {
    const line = element("p", box, panel.label);
    panel.entries = [...new Set(panel.lines.map(each => each.name))].map(name => {
      const lines = panel.lines.filter(each => each.name === name), entry = element("span", line);
      element("i", entry).style.background = lines[0].colour;
      element("b", entry, name);
      return { lines, value: element("b", entry) };
    });
  }

  function zoomable(figure, { label, xs, panels }) {
    const times = xs.map(instants), last = panels[panels.length - 1], home = last.x;
    const box = document.createElement("div"), top = element("p", box);
    const picture = { box, label, panels, home, range: home, hint: element("b", top, HINT) };
    picture.all = element("button", top, "all");
    picture.all.hidden = true;
    picture.all.addEventListener("click", () => reset(picture));
    box.className = "zoom";
    box.setAttribute("role", "group");
    figure.querySelector("svg").after(box);
    for (const panel of panels) {
      const apart = panel.x.some((end, i) => Math.abs(end - home[i]) > 1e-6 * (home[1] - home[0]));
      Object.assign(panel, { picture, overview: apart, home: { x: panel.x, y: panel.y } });
      for (const each of panel.lines) Object.assign(each, { x: times[each.x], y: values(each.y) });
      for (const each of panel.shapes)
        Object.assign(each, { x: values(each.x), y: values(each.y) });
      headed(panel, box);
      charted(panel, box, panel === last, { selected, follow, reset });
    }
    const ends = panels.flatMap(({ lines }) => lines.flatMap(({ x }) => [x[0], x[x.length - 1]]));
    picture.first = Math.min(home[0], ...ends);
    picture.last = Math.max(home[1], ...ends);
    setRange(picture, home);
    pictures.push(picture);
    figure.classList.add("zooms");
    new ResizeObserver(([{ contentRect }]) => {
      const width = Math.floor(contentRect.width);
      for (const { chart, tall } of width ? panels : []) {  // on paper it has no width
        const height = Math.max(LEAST_PX, Math.round(tall * width));
        chart.setSize({ width, height: height + (chart === last.chart ? AXIS_PX : 8) });
      }
    }).observe(box);
  }

  for (const numbers of document.querySelectorAll('figure > script[type="application/json"]'))
    zoomable(numbers.parentElement, JSON.parse(numbers.textContent));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const chart of everyChart()) chart.redraw(false);
  });
})();
