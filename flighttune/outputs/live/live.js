// Sends the values of the sliders that moved, one request at a time and always the newest, and shows the answer.
(() => {
  const mine = String(Math.random()).slice(2), form = document.querySelector("form");
  const at = (id) => document.getElementById(id), all = (which) => [...document.querySelectorAll(which)];
  const of = (key) => all(`[data-key="${key}"]`);
  // A range has the exact value of the start; the number beside it is rounded.
  const exact = (key) => now[key] ?? Number(of(key)[0].defaultValue);
  let now = {}, ghosts = { start: {} }, snapshots = 0;

  const set = (key, value, from) => {
    now[key] = value;
    for (const input of of(key)) {
      input.closest(".row").classList.add("moved");
      if (input.type === "range") {
        input.min = Math.min(input.min, value);
        input.max = Math.max(input.max, value);
      }
      if (input !== from) input.value = input.type === "number" ? Number(value.toPrecision(5)) : value;
    }
  };

  const ask = async (what, more) => {
    const body = JSON.stringify({ window: mine, values: now, ...more });
    return (await fetch(what, { method: "POST", headers: { "Content-Type": "application/json" }, body })).json();
  };
  const say = (text, failed, command) => {
    at("said").className = failed ? "no" : "";
    at("said").textContent = text;
    if (command) at("said").append(": ", Object.assign(document.createElement("code"), { textContent: command }));
  };

  let wanted = false, flying = false, number = 0;
  const redraw = async () => {
    wanted = true;
    if (flying) return;
    flying = true;
    try {
      while (wanted) {
        wanted = false;
        const pieces = await ask("picture", { ghosts });
        if (pieces.failed) { say(pieces.failed, true); continue; }
        if (at("said").className) say("");
        for (const [id, html] of Object.entries(pieces)) if (at(id).innerHTML !== html) at(id).innerHTML = html;
        dispatchEvent(new Event("drawn"));
        document.body.dataset.drawn = ++number;
      }
    } catch {
      say("The command of this page has ended.", true);
    }
    flying = false;
  };

  form.addEventListener("input", ({ target }) => {
    const { key, together } = target.dataset, before = key && exact(key);
    if (!key || target.type === "number" && (target.value === "" || !target.checkValidity())) return;
    let value = target.tagName === "SELECT" ? target.value : Number(target.value);
    if (target.type === "range" && target.step === "any") value = Number(value.toPrecision(4));
    set(key, value, target);
    if (together && before && at("together").checked) {
      for (const other of all(`[type=range][data-together="${together}"]`).map((input) => input.dataset.key)) {
        if (other !== key) set(other, Number((exact(other) * value / before).toPrecision(6)));
      }
    }
    redraw();
  }, true);
  form.onsubmit = () => false;
  at("reset").onclick = () => {
    for (const input of all("[data-key]")) input.value = input.defaultValue ?? input.querySelector("[selected]").value;
    all(".moved").forEach((row) => row.classList.remove("moved"));
    now = {};
    redraw();
  };
  at("snapshot").onclick = () => {
    ghosts = Object.fromEntries([...Object.entries(ghosts), [`snapshot ${++snapshots}`, { ...now }]].slice(-5));
    redraw();
  };
  at("legend").onclick = ({ target: { dataset: { forget } } }) => {
    if (!forget) return;
    delete ghosts[forget];
    redraw();
  };
  for (const button of all("[data-ask]")) {
    button.onclick = async () => {
      const { ask: what, ...more } = button.dataset, answer = await ask(what, more);
      if (answer) say(answer.failed ?? "saved", answer.failed, answer.command);
    };
  }

  new EventSource("events").onmessage = (event) => {
    const state = JSON.parse(event.data);
    at("search").hidden = Boolean(state.done);
    for (const button of all("[data-doing]")) button.ariaBusy = String(!state.done);
    document.querySelector("#search progress").value = state.part;
    say(`${state.doing}: ${state.said}`, state.failed);
    if (!state.done || state.window !== mine) return;
    for (const [key, value] of Object.entries(state.values ?? {})) set(key, value);
    redraw();
  };
  redraw();
})();
