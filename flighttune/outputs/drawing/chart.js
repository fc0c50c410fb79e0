// Charts of a page: values under the pointer or at the cursor of the keys, zoom, hidden lines.
(() => {
  const NS = "http://www.w3.org/2000/svg", CHART = "svg.chart[data-axes]";
  const HINT = "Arrow keys move the cursor, + and − zoom, 0 shows all, Escape ends.";
  // Largest zoom, and in pixels: room around lines, reach of the pointer, shortest drag, a cross.
  const LARGEST = 40, ROOM = 8, REACH = 16, DRAG = 6, CROSS = 5;
  const read = new WeakMap(), hidden = new Set(), zooms = new Map();
  let active, cursor = 0.5, drag;

  const make = (tag, more) => Object.assign(document.createElement(tag), more);
  const mark = (tag, attributes) => {
    const node = document.createElementNS(NS, tag);
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    return node;
  };
  const tip = document.body.appendChild(make("div", { id: "tip", hidden: true }));
  tip.setAttribute("role", "status");
  const tools = make("span", { id: "tools" });
  tools.append(...[["+", "+", "zoom in"], ["−", "−", "zoom out"], ["all", "0", "show all"]].map(([textContent, key, title]) =>
    make("button", { type: "button", textContent, title, ariaLabel: title, tabIndex: -1,
                     onclick: () => active?.svg.isConnected && press(active, key) })));

  // An axis between values and pixels.
  const axis = (low, high, size, isLog, upwards) => {
    const part = (value) => isLog ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    const of = (share) => isLog ? low * (high / low) ** share : low + share * (high - low);
    return {
      size, isLog,
      px: (value) => size * (upwards ? 1 - part(value) : part(value)),
      value: (px) => of(upwards ? 1 - px / size : px / size),
    };
  };
  const partsOf = (line) => line.parts ??= line.path.getAttribute("d").split("M").slice(1)
    .map((part) => part.split(" ").map((pair) => pair.split(",").map(Number)));
  const shown = (node) => node.style.display !== "none";

  const chartOf = (svg) => {
    if (read.has(svg)) return read.get(svg);
    const [x0, x1, y0, y1, width, height] = svg.dataset.axes.split(" ").map(Number);
    const { log, fixed } = svg.dataset, plot = svg.querySelector("svg.plot");
    const marks = [...plot.querySelectorAll("title")].map((title) => {
      const node = title.parentElement, text = title.textContent;
      title.remove();
      return { node, text, at: centre(node) };
    });
    const chart = {
      svg, plot, width, height, fixed, marks: marks.sort((a, b) => a.at[0] - b.at[0]),
      linked: "linked" in svg.dataset, equal: "equal" in svg.dataset,
      x: axis(x0, x1, width, log.includes("x"), false), y: axis(y0, y1, height, log.includes("y"), true),
      lines: [...plot.querySelectorAll("path[data-name]")].map((path) => ({ path, name: path.dataset.name })),
      grid: plot.querySelector(".grid"), ticks: [...svg.querySelectorAll(":scope > text.tick")],
      view: { x: 0, y: 0, width, height },
    };
    chart.edges = plot.querySelector(":scope > .axis:last-of-type");
    [chart.lattice, chart.ends] = [chart.grid, chart.edges].map((path) => path.getAttribute("d"));
    chart.cursor = plot.appendChild(mark("path", { class: "cursor" }));
    read.set(svg, chart);
    return chart;
  };
  const answers = (chart) => chart.lines.length > 0 || chart.marks.length > 0;
  const charts = () => [...document.querySelectorAll(CHART)].map(chartOf);
  const linkedTo = (chart) => chart.linked ? charts().filter((other) => other.linked) : [chart];

  // Centre of a dot, or of a cross or plus, whose path begins at its left end.
  const centre = (node) => {
    if (node.tagName === "circle") return [node.cx.baseVal.value, node.cy.baseVal.value];
    const [, x, y, plus, cross] = /^M([-\d.]+),([-\d.]+)(?:h([\d.]+)|l([\d.]+))/.exec(node.getAttribute("d"));
    return plus ? [+x + plus / 2, +y] : [+x + cross / 2, +y + cross / 2];
  };

  // Height of a line at px, or nothing where it has a gap.
  const at = (line, px) => {
    for (const part of partsOf(line)) {
      if (px < part[0][0] - 0.5 || px > part[part.length - 1][0] + 0.5) continue;
      let low = 0, high = part.length - 1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (part[middle][0] <= px) low = middle; else high = middle;
      }
      const [a, b] = [part[low], part[high]], span = b[0] - a[0];
      return span > 0 ? a[1] + (b[1] - a[1]) * Math.min(1, Math.max(0, (px - a[0]) / span)) : b[1];
    }
  };
  const nearest = (points, [px, py], scale) => points
    .map((point) => [Math.hypot((point.at[0] - px) * scale[0], (point.at[1] - py) * scale[1]), point])
    .reduce((a, b) => (b[0] < a[0] ? b : a), [REACH])[1];
  const vertices = (chart) => chart.lines.filter((line) => shown(line.path)).flatMap((line) =>
    (line.vertices ??= partsOf(line).flat().map((at) => ({ at, name: line.name, node: line.path }))));

  const short = (number) => {
    const size = Math.abs(number);
    return size && (size < 1e-3 || size >= 1e5) ? number.toExponential(2) : String(+number.toPrecision(4));
  };
  const row = (name, text, colour) => {
    const line = make("div"), sign = make("i");
    sign.style.background = colour ?? "transparent";
    line.append(sign, `${name} `, make("b", { textContent: text }));
    return line;
  };
  const colourOf = (node) => getComputedStyle(node).stroke;

  // Rows of the values at a point of the plot; lines of one name share a row.
  const rows = (chart, [px, py], scale) => {
    const found = nearest(chart.marks.filter(({ node }) => shown(node.parentElement)), [px, py], scale);
    const told = found ? [row(found.text, "", colourOf(found.node))] : [];
    if (chart.equal) {
      const point = nearest(vertices(chart), [px, py], scale);
      if (!point) return told;
      const [x0, y0] = point.at, [dx, dy] = scale.map((each) => CROSS / each);
      chart.cursor.setAttribute("d", `M${x0 - dx},${y0}h${2 * dx}M${x0},${y0 - dy}v${2 * dy}`);
      const [x, y] = [chart.x.value(point.at[0]), chart.y.value(point.at[1])].map(short);
      return [row(point.name, "", colourOf(point.node)), row(chart.svg.dataset.x, x), row(chart.svg.dataset.y, y), ...told];
    }
    const named = new Map();
    for (const line of chart.lines) {
      const y = shown(line.path) ? at(line, px) : undefined;
      if (y !== undefined) named.set(line.name, [...(named.get(line.name) ?? []), [y, line]]);
    }
    if (!named.size) return told;
    const values = [...named.values()].map((all) => all.sort((a, b) => b[0] - a[0]))
      .sort((a, b) => a[0][0] - b[0][0])
      .map((all) => {
        const [low, high] = [all[0], all.at(-1)].map(([y]) => short(chart.y.value(y)));
        return row(all[0][1].name, low === high ? low : `${low} to ${high}`, colourOf(all[0][1].path));
      });
    return [row(chart.svg.dataset.x, short(chart.x.value(px))), ...values, ...told];
  };

  const clear = () => {
    tip.hidden = true;
    for (const svg of document.querySelectorAll(CHART)) read.get(svg)?.cursor.setAttribute("d", "");
  };
  const place = (chart, px) => chart.cursor.setAttribute(
    "d", px < 0 || px > chart.width ? "" : `M${px},${chart.view.y}v${chart.view.height}`);

  // Show the values at a point of the plot beside a place on the screen.
  const show = (chart, point, { x, y }) => {
    const { view } = chart, each = chart.svg.getBoundingClientRect().width / chart.svg.viewBox.baseVal.width;
    clear();
    const told = rows(chart, point, [each * chart.width / view.width, each * chart.height / view.height]);
    if (chart.svg !== active?.svg || !tools.isConnected) {
      active = chart;
      chart.svg.after(tools);
    }
    if (!chart.equal && chart.lines.length) {
      const x = chart.x.value(point[0]);
      for (const other of linkedTo(chart)) place(other, other.x.px(x));
    }
    if (!told.length) return;
    tip.replaceChildren(...told);
    tip.hidden = false;
    const { offsetWidth, offsetHeight } = tip, wide = document.documentElement.clientWidth;
    tip.style.left = `${Math.max(4, x + 14 + offsetWidth < wide ? x + 14 : x - 14 - offsetWidth)}px`;
    tip.style.top = `${Math.max(4, Math.min(y + 12, innerHeight - offsetHeight - 4))}px`;
  };
  const toPlot = (chart, { clientX, clientY }) => {
    const { x, y } = new DOMPoint(clientX, clientY).matrixTransform(chart.grid.getScreenCTM().inverse());
    return [x, y];
  };
  const toScreen = (chart, [px, py]) => new DOMPoint(px, py).matrixTransform(chart.grid.getScreenCTM());
  const inside = ({ view }, [px, py]) =>
    px >= view.x && px <= view.x + view.width && py >= view.y && py <= view.y + view.height;

  // Round values along an axis with labels, as `ticks` of chart.py makes them.
  const ticks = (ends, count, isLog) => {
    const [low, high] = [...ends].sort((a, b) => a - b);
    if (isLog) {
      const decades = [];
      for (let e = Math.floor(Math.log10(low)); e <= Math.log10(high); e++)
        decades.push(...[1, 2, 5].map((digit) => digit * 10 ** e));
      const values = decades.filter((value) => value >= low && value <= high);
      if (values.length > 1) return values.map((value) => [value, short(value)]);
    }
    const raw = (high - low) / Math.max(2, count), power = 10 ** Math.floor(Math.log10(raw));
    const far = (step) => Math.abs(Math.log(step / raw));
    const step = [0.5, 1, 2, 5, 10].map((m) => m * power).reduce((a, b) => (far(b) < far(a) ? b : a));
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), values = [];
    for (let i = Math.ceil(low / step - 1e-9); i <= high / step + 1e-9; i++)
      values.push([i * step, (i * step + 0).toFixed(digits).replace("-", "−")]);
    return values;
  };

  // Labels and grid of what is in view; text and points keep their size.
  const draw = (chart) => {
    const { svg, plot, view, width, height } = chart, whole = view.width === width && view.height === height;
    if (whole) plot.removeAttribute("viewBox");
    else plot.setAttribute("viewBox", `${view.x} ${view.y} ${view.width} ${view.height}`);
    plot.setAttribute("preserveAspectRatio", "none");
    const sx = view.width / width, sy = view.height / height;
    for (const node of plot.querySelectorAll("[data-at], circle, g:not([data-at]) > path")) {
      const [x, y] = node.dataset.at?.split(",") ?? centre(node), left = x === "left";
      if (whole) node.removeAttribute("transform");
      else node.setAttribute("transform",
        `translate(${left ? view.x : x},${y}) scale(${sx},${sy}) translate(${left ? 0 : -x},${-y})`);
    }
    svg.querySelectorAll(":scope > text.tick").forEach((label) => label.remove());
    chart.grid.setAttribute("d", whole ? chart.lattice : "");
    chart.edges.setAttribute("d", whole ? chart.ends : `M${view.x},${view.y}v${view.height}h${view.width}`);
    if (whole) return svg.prepend(...chart.ticks);
    const [left, top] = ["x", "y"].map((name) => Number(plot.getAttribute(name))), lattice = [];
    const write = (x, y, anchor, text) => svg.prepend(
      Object.assign(mark("text", { x, y, class: "tick", "text-anchor": anchor }), { textContent: text }));
    if (!chart.fixed.includes("x")) {
      const ends = [view.x, view.x + view.width].map(chart.x.value);
      for (const [value, label] of ticks(ends, width / 64, chart.x.isLog)) {
        const px = chart.x.px(value);
        lattice.push(`M${px},${view.y}v${view.height}`);
        write(left + (px - view.x) / sx, top + height + 15, "middle", label);
      }
    }
    if (!chart.fixed.includes("y")) {
      const ends = [view.y, view.y + view.height].map(chart.y.value);
      for (const [value, label] of ticks(ends, height / 42, chart.y.isLog)) {
        const py = chart.y.px(value);
        lattice.push(`M${view.x},${py}h${view.width}`);
        write(left - 6, top + (py - view.y) / sy + 4, "end", label);
      }
    }
    chart.grid.setAttribute("d", lattice.join(""));
  };

  // Stretch of an axis in view: within the whole, and no shorter than the largest zoom allows.
  const within = (from, to, size) => {
    const length = Math.min(size, Math.max(Math.abs(to - from), size / LARGEST));
    const start = Math.min(Math.max(0, (from + to - length) / 2), size - length);
    return [start, length];
  };
  // Heights of the visible lines between two places.
  const fitted = (chart, from, to) => {
    const heights = chart.lines.filter((line) => shown(line.path)).flatMap((line) =>
      [at(line, from), at(line, to), ...partsOf(line).flat().filter(([x]) => x > from && x < to).map(([, y]) => y)]
        .filter((y) => y !== undefined));
    if (!heights.length) return [0, chart.height];
    const low = heights.reduce((a, b) => Math.min(a, b)), high = heights.reduce((a, b) => Math.max(a, b));
    const room = ROOM * Math.max(high - low, chart.height / LARGEST) / chart.height;
    return [low - room, high + room];
  };
  const keyOf = (chart) => chart.svg.getAttribute("aria-label");
  const zoomOf = (chart) => zooms.get(chart.linked ? "linked" : keyOf(chart));

  // Show what a zoom says: values of x, and heights or those of the lines.
  const apply = (chart) => {
    const zoom = zoomOf(chart);
    if (!zoom) Object.assign(chart.view, { x: 0, y: 0, width: chart.width, height: chart.height });
    else {
      const [x, width] = chart.fixed.includes("x") ? [0, chart.width] : within(...zoom.x.map(chart.x.px), chart.width);
      const ends = zoom.y && (!chart.linked || zoom.of === keyOf(chart)) ? zoom.y.map(chart.y.px) : fitted(chart, x, x + width);
      const [y, height] = chart.fixed.includes("y") ? [0, chart.height] : within(...ends, chart.height);
      Object.assign(chart.view, { x, y, width, height });
    }
    draw(chart);
  };
  // Zoom to a part of the plot in pixels; without heights, to the lines in it.
  const zoomTo = (chart, x, y) => {
    const key = chart.linked ? "linked" : keyOf(chart);
    if (!x) zooms.delete(key);
    else zooms.set(key, { x: x.map(chart.x.value), y: y?.map(chart.y.value), of: keyOf(chart) });
    clear();
    linkedTo(chart).forEach(apply);
  };
  const zoomBy = (chart, factor, [px, py]) => {
    const { view, width, height } = chart;
    if (factor > 1 && view.width * factor >= width) return zoomTo(chart);
    const about = (middle, from, length) => [middle - (middle - from) * factor, middle + (from + length - middle) * factor];
    const both = chart.equal || !chart.lines.length;
    zoomTo(chart, about(px, view.x, view.width), both ? about(py, view.y, view.height) : undefined);
  };

  // The point of the cursor of the keys: on a map along its first line, else along x.
  const pointed = (chart) => {
    const points = chart.equal ? vertices(chart) : chart.lines.length ? [] : chart.marks;
    if (points.length) return points[Math.round(cursor * (points.length - 1))].at;
    return [chart.view.x + cursor * chart.view.width, chart.view.y + chart.view.height / 2];
  };
  const press = (chart, key, fine) => {
    const step = { ArrowLeft: -1, ArrowRight: 1, Home: -Infinity, End: Infinity }[key];
    const zoom = { "+": 0.5, "=": 0.5, "-": 2, "−": 2 }[key];
    if (key === "Escape") { clear(); return true; }
    if (zoom) zoomBy(chart, zoom, pointed(chart));
    else if (key === "0") zoomTo(chart);
    else if (step) cursor = Math.min(1, Math.max(0, cursor + step * (fine ? 0.005 : 0.02)));
    else return false;
    if (!chart.svg.matches(":focus")) return true;
    const point = pointed(chart);
    show(chart, point, toScreen(chart, point));
    return true;
  };

  // What is hidden stays hidden, and what is zoomed zoomed, when charts are drawn anew.
  const scopeOf = (node) => node.closest(".panels") ?? node.closest("figure");
  const nameOf = (node) => scopeOf(node)?.querySelector("[aria-label]")?.getAttribute("aria-label");
  const keyFor = (node) => "run" in node.dataset ? `run ${node.dataset.run}` : `part ${nameOf(node)} ${node.dataset.part}`;
  const refresh = () => {
    for (const { svg } of charts().filter(answers)) {
      svg.tabIndex = 0;
      svg.ariaDescription = HINT;
      svg.setAttribute("role", "application");
    }
    for (const button of document.querySelectorAll("button[data-run], button[data-part]")) {
      const { run, part } = button.dataset, within = run === undefined ? scopeOf(button) : document;
      const wanted = run === undefined ? "part" : "run", off = hidden.has(keyFor(button));
      const owned = [...within?.querySelectorAll(`svg.plot [data-${wanted}]`) ?? []]
        .filter((node) => node.dataset[wanted] === (run ?? part));
      button.disabled = !owned.length;
      button.setAttribute("aria-pressed", String(!off));
      for (const node of owned) node.style.display = isHidden(node) ? "none" : "";
    }
    if (zooms.size) charts().forEach(apply);
  };
  const isHidden = (node) => "run" in node.dataset && hidden.has(`run ${node.dataset.run}`)
    || "part" in node.dataset && hidden.has(`part ${nameOf(node)} ${node.dataset.part}`);

  const chartAt = (event) => {
    const svg = event.target.closest?.(CHART), chart = svg && chartOf(svg);
    return chart && answers(chart) ? chart : undefined;
  };
  const select = ({ chart, from, to, tall }) => {
    const [left, right] = [from[0], to[0]].sort((a, b) => a - b), { view } = chart;
    const flat = !tall && !chart.equal;
    const [top, bottom] = flat ? [view.y, view.y + view.height] : [from[1], to[1]].sort((a, b) => a - b);
    return { x: [left, right], y: flat ? undefined : [top, bottom], top, bottom };
  };
  addEventListener("pointerdown", (event) => {
    const chart = chartAt(event);
    if (!chart) return event.target.closest?.("#tools") || clear();
    const from = toPlot(chart, event);
    if (event.button || !inside(chart, from)) return;
    if (event.pointerType === "touch") return show(chart, from, { x: event.clientX, y: event.clientY });
    chart.svg.setPointerCapture(event.pointerId);
    drag = { chart, from, to: from, start: event, box: null, tall: false };
  }, true);
  addEventListener("pointermove", (event) => {
    if (drag) {
      const { chart, start } = drag, [dx, dy] = [event.clientX - start.clientX, event.clientY - start.clientY];
      drag.to = toPlot(chart, event);
      drag.tall = Math.abs(dy) > 4 * DRAG;
      if (!drag.box && Math.hypot(dx, dy) < DRAG) return;
      const { x, top, bottom } = select(drag);
      clear();
      drag.box ??= chart.plot.appendChild(mark("rect", { class: "selected" }));
      for (const [name, value] of Object.entries({ x: x[0], y: top, width: x[1] - x[0], height: bottom - top }))
        drag.box.setAttribute(name, value);
      return;
    }
    const chart = chartAt(event), point = chart && toPlot(chart, event);
    if (chart && inside(chart, point)) show(chart, point, { x: event.clientX, y: event.clientY });
    else clear();
  }, true);
  addEventListener("pointerup", () => {
    if (drag?.box) {
      const { x, y } = select(drag), { chart } = drag;
      drag.box.remove();
      if (x[1] - x[0] > 0) zoomTo(chart, x, y);
    }
    drag = undefined;
  }, true);
  addEventListener("pointercancel", () => { drag?.box?.remove(); drag = undefined; }, true);
  addEventListener("dblclick", (event) => {
    const chart = chartAt(event);
    if (chart) zoomTo(chart);
  });
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const chart = chartAt(event);
    if (chart && press(chart, event.key, event.shiftKey)) event.preventDefault();
  });
  addEventListener("focusin", (event) => {
    const chart = chartAt(event);
    if (!chart?.svg.matches(":focus-visible")) return;
    const point = pointed(chart);
    show(chart, point, toScreen(chart, point));
  });
  addEventListener("focusout", (event) => chartAt(event) && clear());
  addEventListener("click", (event) => {
    const button = event.target.closest?.("button[data-run], button[data-part]");
    if (!button) return;
    const key = keyFor(button);
    if (!hidden.delete(key)) hidden.add(key);
    refresh();
  });
  addEventListener("drawn", refresh);
  refresh();
})();
