// Values under the pointer, one cursor over all linked charts, runs hidden from the legend.
(() => {
  const charts = [...document.querySelectorAll("svg.chart[data-axes]")].map((svg) => {
    const [x0, x1, y0, y1, width, height] = svg.dataset.axes.split(" ").map(Number);
    const log = svg.dataset.log, plot = svg.querySelector("svg.plot");
    const value = (part, low, high, isLog) =>
      isLog ? low * (high / low) ** part : low + part * (high - low);
    return {
      svg, plot, width, linked: "linked" in svg.dataset,
      x: (px) => value(px / width, x0, x1, log.includes("x")),
      y: (py) => value(1 - py / height, y0, y1, log.includes("y")),
      px: (x) => width * (log.includes("x") ? Math.log(x / x0) / Math.log(x1 / x0) : (x - x0) / (x1 - x0)),
      lines: [...plot.querySelectorAll("path[data-name]")].map((path) => ({ path, parts: null })),
      cursor: null, height,
    };
  }).filter((chart) => chart.lines.length);

  const tip = document.body.appendChild(document.createElement("div"));
  tip.id = "tip";
  tip.hidden = true;

  const partsOf = (line) => line.parts ??= line.path.getAttribute("d").split("M").slice(1)
    .map((part) => part.split(" ").map((pair) => pair.split(",").map(Number)));

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

  const place = (chart, px) => {
    if (!chart.cursor) {
      chart.cursor = document.createElementNS("http://www.w3.org/2000/svg", "path");
      chart.cursor.setAttribute("class", "cursor");
      chart.plot.append(chart.cursor);
    }
    chart.cursor.setAttribute("d", px < 0 || px > chart.width ? "" : `M${px},0V${chart.height}`);
  };
  const clear = () => {
    tip.hidden = true;
    charts.forEach((chart) => chart.cursor?.setAttribute("d", ""));
  };
  const short = (number) => {
    const size = Math.abs(number);
    return size && (size < 1e-3 || size >= 1e5) ? number.toExponential(2) : String(+number.toPrecision(4));
  };

  const show = (chart, event) => {
    const box = chart.plot.getScreenCTM().inverse();
    const px = new DOMPoint(event.clientX, event.clientY).matrixTransform(box).x;
    if (px < 0 || px > chart.width) return clear();
    const x = chart.x(px);
    (chart.linked ? charts.filter((one) => one.linked) : [chart]).forEach((one) => place(one, one.px(x)));
    const row = (name, text, colour) => {
      const line = document.createElement("div"), sign = document.createElement("i");
      sign.style.background = colour ?? "transparent";
      line.append(sign, `${name} `, Object.assign(document.createElement("b"), { textContent: text }));
      return line;
    };
    const values = chart.lines.filter((line) => line.path.style.display !== "none")
      .map((line) => [line, at(line, px)]).filter(([, y]) => y !== undefined)
      .sort((a, b) => a[1] - b[1])
      .map(([line, y]) => row(line.path.dataset.name, short(chart.y(y)), getComputedStyle(line.path).stroke));
    tip.replaceChildren(row(chart.svg.dataset.x, short(x)), ...values);
    tip.hidden = false;
    const { offsetWidth, offsetHeight } = tip;
    const left = event.clientX + 14, wide = document.documentElement.clientWidth;
    tip.style.left = `${Math.max(4, left + offsetWidth < wide ? left : event.clientX - 14 - offsetWidth)}px`;
    tip.style.top = `${Math.max(4, Math.min(event.clientY + 12, innerHeight - offsetHeight - 4))}px`;
  };
  for (const chart of charts) {
    chart.svg.addEventListener("pointermove", (event) => show(chart, event));
    chart.svg.addEventListener("pointerleave", clear);
  }

  for (const button of document.querySelectorAll("button[data-run]")) {
    button.addEventListener("click", () => {
      const hide = button.getAttribute("aria-pressed") === "true", run = button.dataset.run;
      for (const one of document.querySelectorAll("[data-run]")) {
        if (one.dataset.run !== run) continue;
        if (one === button || one.matches("button")) one.setAttribute("aria-pressed", String(!hide));
        else one.style.display = hide ? "none" : "";
      }
    });
  }

  // A link to a folded part opens it.
  const open = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    for (let one = target; one; one = one.parentElement) if (one.matches("details")) one.open = true;
    if (target) target.scrollIntoView();
  };
  addEventListener("hashchange", open);
  open();
})();
