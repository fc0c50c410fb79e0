// Sends the values of the sliders that moved, one request at a time and always the newest, and shows the answer.
(() => {
  const mine = crypto.randomUUID(), form = document.querySelector("form");
  const at = (id) => document.getElementById(id), all = (which) => [...document.querySelectorAll(which)];
  const inputs = Object.fromEntries([...form.elements].filter(({ name }) => name).map((input) => [input.name, input]));
  const valueOf = ({ type, value }) => (type.startsWith("select") ? value : Number(value));
  const start = Object.fromEntries(Object.entries(inputs).map(([key, input]) => [key, valueOf(input)]));
  // Exact values: a number beside a slider is rounded.
  const now = { ...start };
  const moved = () => Object.fromEntries(Object.entries(now).filter(([key, value]) => value !== start[key]));
  let ghosts = { start: {} }, snapshots = 0;

  const say = (text, failed, command) => {
    at("said").className = failed ? "no" : "";
    at("said").textContent = text;
    if (command) at("said").append(": ", Object.assign(document.createElement("code"), { textContent: command }));
  };
  // What was drawn before belongs to other values: no verdict of it stays, and the rest is dimmed.
  const refuse = (refused) => {
    document.body.classList.toggle("refused", Boolean(refused));
    for (const part of all("#legend, #charts, .beside")) part.ariaHidden = refused ? "true" : null;
    if (!refused) return;
    const said = { className: "verdict", textContent: "? Not flown with these values." };
    at("verdict").replaceChildren(Object.assign(document.createElement("p"), said));
  };
  const ask = async (what, more) => {
    const body = JSON.stringify({ window: mine, values: moved(), ...more });
    return (await fetch(what, { method: "POST", headers: { "Content-Type": "application/json" }, body, keepalive: true })).json();
  };

  let wanted = false, flying = false, number = 0;
  const redraw = async () => {
    wanted = true;
    if (flying) return;
    flying = true;
    try {
      while (wanted) {
        wanted = false;
        const { pieces, failed } = await ask("picture", { ghosts });
        refuse(pieces ? "" : failed);
        if (failed) say(failed, true);
        else if (at("said").className) say("");
        if (!pieces) continue;
        for (const { id, innerHTML } of new DOMParser().parseFromString(pieces, "text/html").body.children)
          if (at(id).innerHTML !== innerHTML) at(id).innerHTML = innerHTML;
        dispatchEvent(new Event("drawn"));
        document.body.dataset.drawn = ++number;
      }
    } catch {
      refuse(true);
      say("The command of this page has ended.", true);
    }
    flying = false;
  };

  // Sets sliders and the numbers beside them, but for the one that is being typed.
  const set = (values, typed) => {
    Object.assign(now, values);
    for (const [key, value] of Object.entries(values)) {
      const input = inputs[key];
      if (input.type === "range") {
        input.min = Math.min(input.min, value);
        input.max = Math.max(input.max, value);
        if (at(key) !== typed) at(key).value = Number(value.toPrecision(5));
      }
      input.value = value;
      input.closest(".row").classList.toggle("moved", value !== start[key]);
    }
    redraw();
  };
  form.oninput = ({ target }) => {
    const key = target.name || target.id, { together } = inputs[key]?.dataset ?? {};
    if (!inputs[key] || target.value === "" || !target.checkValidity()) return;
    let value = valueOf(target);
    if (target.step === "any" && target.name) value = Number(value.toPrecision(4));
    const values = { [key]: value };
    if (together && now[key] && at("together").checked)
      for (const other of all(`[data-together="${together}"]`).filter(({ name }) => name !== key))
        values[other.name] = Number((now[other.name] * value / now[key]).toPrecision(6));
    set(values, target);
  };
  form.onsubmit = () => false;
  at("reset").onclick = () => set(start);
  at("snapshot").onclick = () => {
    ghosts = Object.fromEntries([...Object.entries(ghosts), [`snapshot ${++snapshots}`, moved()]].slice(-5));
    redraw();
  };
  at("legend").onclick = ({ target: { dataset: { forget } } }) => {
    if (forget && delete ghosts[forget]) redraw();
  };
  for (const button of all("[data-ask]")) {
    button.onclick = async () => {
      const { ask: what, ...more } = button.dataset, answer = await ask(what, more);
      if (answer) say(answer.failed ?? "saved", answer.failed, answer.command);
    };
  }

  let searching = false;
  new EventSource("events").onmessage = ({ data }) => {
    const { doing, said, part, done, failed, differs, window, values } = JSON.parse(data);
    searching = !done && window === mine;
    at("search").hidden = Boolean(done);
    for (const button of all("[data-doing]")) button.disabled = !done;
    document.querySelector("progress").value = part;
    say(`${doing}: ${said}`, failed);
    if (done && window === mine) set(values ?? {});
    if (differs) redraw();
  };
  // A search ends with its window: the gains that it finds would have no sliders to move.
  addEventListener("pagehide", () => searching && ask("stop"));
  redraw();
})();
