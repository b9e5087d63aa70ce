// One chart of a picture that zooms, by uPlot: its axes and lines, and what lies behind these.
"use strict";
const yawidCharts = (() => {
  const LEFT_PX = 58, DRAG_PX = 6, FONT = "11px sans-serif";
  const NONE = { left: 0, top: 0, width: 0, height: 0 };
  const ink = name => () => getComputedStyle(document.documentElement).getPropertyValue(name);

  function shown(x) {
    const size = Math.abs(x);
    if (!size || (size >= 1e-3 && size < 1e6)) return String(+x.toPrecision(5));
    return x.toExponential(2).replace(/\.?0+e/, "e");
  }

  // Draw what lies behind the lines: spans, areas and bars, levels, and numbers of manoeuvres.
  function decorate(chart, panel) {
    const { ctx, bbox: { left, top, width, height } } = chart, dot = devicePixelRatio;
    const X = x => chart.valToPos(x, "x", true), Y = y => chart.valToPos(y, "y", true);
    function clip(...box) {
      ctx.save();
      ctx.beginPath();
      ctx.rect(...box);
      ctx.clip();
    }
    function path(...points) {
      ctx.beginPath();
      for (const [x, y] of points) ctx.lineTo(x, y);
    }
    clip(left, top, width, height);
    ctx.lineWidth = dot;
    for (const { x, fill, hatch } of panel.spans) {
      const from = Math.max(X(x[0]), left), to = Math.min(X(x[1]), left + width);
      if (from >= to) continue;
      clip(from, top, to - from, height);
      ctx.fillStyle = fill;
      ctx.fillRect(from, top, to - from, height);
      ctx.strokeStyle = ink("--edge")();
      for (let at = from - height; hatch && at < to; at += 7 * dot) {
        path([at, top + height], [at + height, top]);
        ctx.stroke();
      }
      ctx.restore();
    }
    for (const { x, y, fill, colour } of panel.shapes) {
      path(...x.map((each, i) => [X(each), Y(y[i])]));
      ctx.fillStyle = ctx.strokeStyle = colour;
      if (fill) ctx.fill(); else ctx.stroke();
    }
    for (const { at, upright, colour, dash } of panel.levels) {
      ctx.setLineDash((dash || []).map(x => x * dot));
      ctx.strokeStyle = colour;
      if (upright) path([X(at), top], [X(at), top + height]);
      else path([left, Y(at)], [left + width, Y(at)]);
      ctx.stroke();
    }
    ctx.setLineDash([]);
    ctx.font = `${11 * dot}px sans-serif`;
    ctx.textAlign = "center";
    ctx.fillStyle = ctx.strokeStyle = ink("--ink")();
    for (const [x, text] of panel.numbers) ctx.fillText(text, X(x), top + 11 * dot);
    const [from, to] = panel.picture.range.map(X);
    if (panel.overview) ctx.strokeRect(from, top + dot, to - from, height - 2 * dot);
    ctx.restore();
  }

  // A finger across a chart is a mouse to it; up and down it scrolls the page.
  function touchable(chart) {
    const kinds = { pointerdown: "mousedown", pointermove: "mousemove", pointerup: "mouseup",
      pointercancel: "mouseup" };
    for (const [kind, mouse] of Object.entries(kinds))
      chart.over.addEventListener(kind, ({ type, pointerType, clientX, clientY }) => {
        if (pointerType !== "touch") return;
        if (type === "pointercancel") chart.setSelect(NONE, false);
        const same = { bubbles: true, clientX, clientY, movementX: 1 };
        chart.over.dispatchEvent(new MouseEvent(mouse, same));
      });
  }

  // The ticks of a logarithmic axis. uPlot's own never end where one begins just below a decade.
  function decades(_, axis, min, max) {
    const all = [], digits = max < 5 * min ? "123456789" : max < 1000 * min ? "125" : "1";
    for (let e = Math.floor(Math.log10(min)); 10 ** e <= max; e += 1)
      for (const digit of digits) all.push(Number(`${digit}e${e}`));
    const inside = all.filter(x => x >= min && x <= max);
    const even = [1, 3, 5, 7].map(k => +(min + (max - min) * k / 8).toPrecision(5));
    return inside.length > 1 ? inside : even;
  }

  // Make the chart of a panel; `acts` has what is done at its selection, cursor and double click.
  function charted(panel, box, last, acts) {
    const { picture, overview } = panel, grid = { stroke: ink("--rule"), width: 1 };
    const texts = show => (_, all) => all.map(x => (x === null || !show ? "" : shown(x)));
    const axis = { font: FONT, stroke: ink("--soft"), grid, ticks: { ...grid, size: 4 } };
    const named = { size: 20, label: picture.label, labelSize: 18, labelFont: FONT };
    const logarithmic = { splits: decades, filter: (_, all) => all };
    const scale = log => ({ time: false, distr: log ? 3 : 1 });
    const drawn = panel.lines.map(({ colour, width, dash, dots, steps }) => ({
      stroke: colour, width, dash: dash || undefined,
      paths: dots ? () => null : steps ? uPlot.paths.stepped({ align: 1 }) : undefined,
      points: { fill: colour, size: 5, ...(dots && { show: true }) },
    }));
    panel.chart = new uPlot({
      width: 400, height: 100, legend: { show: false }, padding: [8, 12, last ? 0 : 4, 0],
      scales: {
        x: { ...scale(panel.logX), range: (_, min, max) => [min, max] },
        y: { ...scale(panel.logY), range: () => panel.y },
      },
      axes: [
        { ...axis, ...(last ? named : { size: 4 }), values: texts(last),
          ...(panel.logX && logarithmic) },
        { ...axis, values: texts(!overview), size: LEFT_PX, space: 18,
          ...(panel.logY && logarithmic) },
      ],
      series: [{}, ...drawn],
      cursor: {
        drag: { x: true, y: !overview, uni: 30, dist: DRAG_PX, setScale: false },
        bind: { dblclick: () => () => acts.reset(picture) },
      },
      hooks: {
        drawAxes: [chart => decorate(chart, panel)],
        setSelect: [chart => acts.selected(chart, panel)],
        setCursor: [chart => acts.follow(chart, panel)],
      },
    }, uPlot.join(panel.lines.map(({ x, y }) => [x, y])), box);
    panel.chart.setScale("x", { min: panel.home.x[0], max: panel.home.x[1] });
    touchable(panel.chart);
  }

  return { charted, shown, DRAG_PX, NONE };
})();
