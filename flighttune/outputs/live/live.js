// Sends the values of the sliders, one request at a time and always the newest, and shows the answer.
(() => {
  const mine = String(Math.random()).slice(2), at = (id) => document.getElementById(id);
  const inputs = [...document.querySelectorAll("[data-key]")];
  const of = (key) => inputs.filter((input) => input.dataset.key === key);
  const read = (input) => input.tagName === "SELECT" ? input.value : Number(input.value);
  const keys = [...new Set(inputs.map((input) => input.dataset.key))];
  // `now` holds the exact values: a slider has ends, and the number beside it is rounded.
  const values = () => Object.fromEntries(keys.map((key) => [key, now[key]]));
  const exact = (input) => "value" in input.dataset ? Number(input.dataset.value) : read(input);
  const start = Object.fromEntries(keys.map((key) => [key, exact(of(key).at(-1))])), now = { ...start };
  let ghosts = [{ name: "start", values: start }], snapshots = 0;

  const set = (key, value, from) => {
    now[key] = value;
    for (const input of of(key)) {
      if (input === from) continue;
      if (input.type === "range") {
        input.min = Math.min(input.min, value);
        input.max = Math.max(input.max, value);
      }
      input.value = input.type === "number" ? Number(value.toPrecision(5)) : value;
    }
    of(key)[0].closest(".row").classList.toggle("moved", now[key] !== start[key]);
  };

  const ask = async (what, body) => {
    const answer = await fetch(what, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ window: mine, ...body }),
    });
    return answer.json();
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
        const pieces = await ask("picture", { values: values(), ghosts });
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

  at("legend").addEventListener("click", ({ target }) => {
    if (!target.dataset.forget) return;
    ghosts = ghosts.filter((ghost) => ghost.name !== target.dataset.forget);
    redraw();
  });

  for (const input of inputs) {
    input.addEventListener("input", () => {
      const key = input.dataset.key;
      if (input.type === "number" && (input.value === "" || !input.checkValidity())) return;
      const before = now[key];
      let value = read(input);
      if (input.type === "range" && input.step === "any") value = Number(value.toPrecision(4));
      set(key, value, input);
      const kind = of(key)[0].dataset.together;
      if (kind && at("together").checked && before) {
        for (const other of keys.filter((one) => one !== key && of(one)[0].dataset.together === kind)) {
          set(other, Number((now[other] * value / before).toPrecision(6)));
        }
      }
      redraw();
    });
  }
  document.querySelector("form.sliders").onsubmit = () => false;
  at("reset").onclick = () => { keys.forEach((key) => set(key, start[key])); redraw(); };
  at("snapshot").onclick = () => {
    ghosts = [...ghosts, { name: `snapshot ${++snapshots}`, values: values() }].slice(-5);
    redraw();
  };
  for (const button of document.querySelectorAll("[data-begin]")) {
    button.onclick = async () => {
      const answer = await ask("begin", { doing: button.dataset.begin, values: values() });
      if (answer?.failed) say(answer.failed, true);
    };
  }
  for (const button of document.querySelectorAll("[data-save]")) {
    button.onclick = async () => {
      const answer = await ask("save", { values: values(), recorded: button.dataset.save === "yes" });
      say(answer.failed ?? answer.said, Boolean(answer.failed), answer.command);
    };
  }
  at("stop").onclick = () => ask("stop", {});

  new EventSource("events").onmessage = (event) => {
    const state = JSON.parse(event.data);
    at("search").hidden = Boolean(state.done);
    for (const button of document.querySelectorAll("[data-begin]")) button.ariaBusy = String(!state.done);
    document.querySelector("#search progress").value = state.part ?? 1;
    say(`${state.doing}: ${state.said}`, state.failed);
    if (!state.done || state.window !== mine) return;
    for (const [key, value] of Object.entries(state.values ?? {})) set(key, value);
    redraw();
  };
  redraw();
})();
