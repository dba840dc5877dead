/*
 * The editor of a scenario: people as lanes of tasks on a clock and as paths on the map; see studio.js and world.js.
 *
 * After every change the studio repairs what follows from it and simulates one run; when the hand rests, twenty.
 */
(function (root) {
  "use strict";
  const studio = root.studio, html = studio.html, svg = studio.svg, ask = studio.ask, send = studio.send;
  const RESTS_MS = 500, SEEDS = 20, FLASH_MS = 2500;

  studio.parts.scenario = function (element) {
    const source = JSON.parse(element.dataset.source), query = "?" + new URLSearchParams(source);
    let data = null, scenario = null, drawing = null, where = new Map(), tried = null, drag = null, chosen = 0, turn = 0, before = element.dataset.before || "", moved = null, asIs = false, resting = null, requirement = element.dataset.requirement || "R1";
    const undone = [], done = [], typed = studio.typing("scenario" + query, fail);
    const status = html(element, "p", { class: "st-message", role: "status" });
    const bar = html(element, "div", { class: "st-actions", role: "toolbar", "aria-label": "Scenario" });
    const verdict = html(element, "div", { class: "st-try", role: "status", "aria-live": "polite" });
    const body = html(element, "div", { class: "st-editor" });
    const left = html(body, "div", { class: "st-editor-map" }), right = html(body, "div", { class: "st-editor-side" });
    const skeleton = html(left, "div", { class: "st-skeleton st-tall", "aria-hidden": "true" });
    const lanes = html(left, "div", { class: "st-lanes" });
    const replayBox = html(element, "div", {});

    function say(text, bad) { status.textContent = text; status.classList.toggle("st-wrong", !!bad); }
    function fail(error) { say(error.message, true); }
    function people() { return scenario.people.humans; }
    function colour(k) { return data.colours[k % data.colours.length]; }
    function question(more) { return Object.assign({}, source, { scenario: scenario, requirement: requirement, as_is: asIs }, more); }
    function differs() { return JSON.stringify(scenario) !== JSON.stringify(data.original); }
    const shared = studio.shared("scenario" + query, function () { return drag || writing; }, function () { ask("/data/scenario" + query).then(take).catch(fail); });

    /* simulate after a change */
    let writing = "", flash = null;
    function keep() { writing = ""; done.push(JSON.stringify(scenario)); undone.length = 0; if (done.length > 100) done.shift(); }
    /** What differs from the file is on the disk after every change, before anything is simulated. */
    const store = studio.latest(function () { return send("/data/scenario-keep", question()).then(shared).catch(fail); });
    /** Take what a repair made of a change; where it changed the path that was just dragged, say why, and offer the point as it was. */
    function repaired(found, why) {
      if (JSON.stringify(found) === JSON.stringify(scenario)) { moved = null; return; }
      const mine = JSON.stringify(scenario), person = moved;
      scenario = found; moved = null;
      if (done.length) store();  // another tab may have changed it, this one has not
      if (person === null || !why.length) return;
      say("Repaired: " + why.join("; ") + ". ");
      studio.button(status, "Keep my point", function () { scenario = JSON.parse(mine); asIs = true; store(); show(); say("Kept as it is."); simulate(1); }, { class: "st-button st-small" });
      flash = person;
      setTimeout(function () { flash = null; draw(); }, FLASH_MS);
    }
    /** How often the original violates: what a finding says, else what its runs do here. */
    function compare() {
      if (before) return;
      before = "\u2026";
      send("/data/scenario-try", question({ scenario: data.original, seeds: SEEDS, as_is: true })).then(function (found) { before = found.violations + "/" + found.runs; showVerdict(); }).catch(fail);
    }
    function simulate(seeds, more) {
      const mine = ++turn;
      return send("/data/scenario-try", question(Object.assign({ seeds: seeds }, more))).then(function (found) {
        if (mine !== turn) return;
        tried = found;
        if (!drag) repaired(found.scenario, found.repairs);
        show();
        if (seeds === 1 && !drag && !found.problems.length) { clearTimeout(resting); resting = setTimeout(function () { simulate(SEEDS); }, RESTS_MS); }
      }).catch(function (error) { if (mine === turn) fail(error); });
    }
    function changed() { say(""); asIs = false; store(); show(); simulate(1); }
    function edit(change) { keep(); change(); changed(); }
    /** Change something with every keystroke in a field; the keystrokes are undone together. */
    function write(field, change) { if (writing !== field) { keep(); writing = field; } change(); changed(); }

    /* tools */
    const select = studio.labelled(bar, "Requirement", html(null, "select", {}));
    select.addEventListener("change", function () { requirement = select.value; simulate(1); });
    const undo = studio.button(bar, "Undo", function () { if (done.length) { undone.push(JSON.stringify(scenario)); scenario = JSON.parse(done.pop()); changed(); } });
    const redo = studio.button(bar, "Redo", function () { if (undone.length) { done.push(JSON.stringify(scenario)); scenario = JSON.parse(undone.pop()); changed(); } });
    const discard = studio.button(bar, "Discard changes", function () { send("/data/scenario-discard", source).then(take).then(shared).catch(fail); });
    studio.button(bar, "Replay 20 runs", function () {
      say("Simulating\u2026");
      send("/data/scenario-replay", question()).then(function (found) {
        say(""); replayBox.textContent = "";
        element.replay = rvsgReplay.mount(html(replayBox, "div", {}), found, {});
        replayBox.scrollIntoView({ block: "nearest" });
      }).catch(fail);
    });

    /* the map */
    function nearest(p) {
      let best = null, least = Infinity;
      data.waypoints.forEach(function (w) { const d = Math.hypot(w[1] - p[0], w[2] - p[1]); if (d < least) { least = d; best = w[0]; } });
      return best;
    }
    function position(human, name) { return (human.points && human.points[name]) || where.get(name); }
    function text(points) { return points.map(function (p) { return p.join(","); }).join(" "); }
    function draw() {
      const held = drawing.map.contains(document.activeElement) && document.activeElement.dataset.handle;
      drawing.metres.textContent = ""; drawing.words.textContent = "";
      const route = scenario.mission.route;
      if (differs()) data.original.people.humans.forEach(function (human) {
        human.tasks.forEach(function (task) { svg(drawing.metres, "polyline", { class: "st-ghost", points: text(task.path.map(function (name) { return position(human, name); }).filter(Boolean)) }); });
      });
      if (tried && tried.robot.length) svg(drawing.metres, "polyline", { class: "st-robot", points: text(tried.robot) });
      [["start", "S"], ["goal", "G"]].forEach(function (end) { drawing.mark(route[end[0]].x, route[end[0]].y, end[1], "st-end"); });
      people().forEach(function (human, k) {
        const on = k === chosen;
        if (tried && tried.people[human.name]) svg(drawing.metres, "polyline", { class: "st-walked", stroke: colour(k), points: text(tried.people[human.name]) });
        human.tasks.forEach(function (task, t) {
          const line = svg(drawing.metres, "polyline", { class: "st-planned" + (on ? " st-chosen" : "") + (k === flash ? " st-flash" : ""), stroke: colour(k), points: text(task.path.map(function (name) { return position(human, name); }).filter(Boolean)) });
          line.addEventListener("pointerdown", function () { choose(k); });
        });
        const first = human.tasks.length && position(human, human.tasks[0].path[0]);
        if (first) { const p = drawing.place(first[0], first[1]); svg(drawing.words, "text", { class: "st-person", fill: colour(k), x: p[0], y: p[1] - 0.35, "font-size": 0.45 }, human.name); }
      });
      /* the handles last: no line of another task or person lies over them */
      const mine = people()[chosen];
      if (mine) mine.tasks.forEach(function (task, t) {
        task.path.forEach(function (name, at) {
          const p = position(mine, name);
          if (!p || (at === 0 && t > 0)) return;
          const end = at === 0 || at === task.path.length - 1;
          const dot = svg(drawing.metres, "circle", { class: "st-handle", cx: p[0], cy: p[1], r: Math.max(end ? 0.16 : 0.09, (end ? 9 : 6) * drawing.pixel()), "data-waypoint": name, "data-task": t, "data-handle": t + "/" + at, tabindex: end ? 0 : -1, role: "button", "aria-label": mine.name + ", task " + (t + 1) + ", at " + name + ": arrow keys move it" });
          dot.addEventListener("keydown", function (event) {
            const to = beside(name, event.key);
            if (!to) return;
            event.preventDefault(); event.stopPropagation();
            moved = chosen;
            edit(function () { replaceAt(people()[chosen], t, at, to); });
          });
          dot.addEventListener("pointerdown", function (event) {
            event.stopPropagation(); event.preventDefault();
            keep(); drag = { human: chosen, task: t, at: at, name: name, sent: 0 };
            drawing.map.setPointerCapture(event.pointerId);
          });
        });
      });
      const again = held && drawing.map.querySelector('[data-handle="' + held + '"]');
      if (again) again.focus();
    }
    const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    /** The nearest waypoint in the direction of an arrow key, as the map shows it. */
    function beside(name, key) {
      const way = WAYS[key], here = where.get(name);
      if (!way || !here) return null;
      const p = drawing.place(here[0], here[1]);
      let best = null, least = Infinity;
      data.waypoints.forEach(function (w) {
        const q = drawing.place(w[1], w[2]), along = (q[0] - p[0]) * way[0] + (q[1] - p[1]) * way[1], off = Math.abs((q[0] - p[0]) * way[1] - (q[1] - p[1]) * way[0]);
        if (along > 0.01 && off <= along && along + 2 * off < least) { least = along + 2 * off; best = w[0]; }
      });
      return best;
    }
    /** Put a waypoint in the place of another in a path, and in the task that begins where this one ends. */
    function replaceAt(human, t, at, to) {
      const tasks = human.tasks, task = tasks[t], count = tasks.length, last = task.path.length - 1, from = task.path[at];
      task.path[at] = to;
      if (at === last) { tasks[(t + 1) % count].path[0] = to; named(tasks[(t + 1) % count]); }
      if (at === 0) { const before = tasks[(t + count - 1) % count]; before.path[before.path.length - 1] = to; named(before); }
      if (at === 0 || at === last) named(task);
      tasks.forEach(function (each) {  // what is done there is done at the new place
        each.pauses.forEach(function (pause) { if (pause.at === from && !each.path.includes(from)) pause.at = to; });
      });
    }
    function named(task) { task.name = task.path[0] + " \u2192 " + task.path[task.path.length - 1]; task.start_area = null; task.end_area = null; }
    function startMap() {
      drawing = studio.plan(left, data.floor, "Map of " + data.title);
      drawing.map.setAttribute("role", "group");  // its handles take the focus
      left.insertBefore(drawing.map, lanes);
      drawing.map.addEventListener("framed", draw);
      drawing.map.addEventListener("pointermove", function (event) {
        if (!drag) return;
        const to = nearest(drawing.at(event)), human = people()[drag.human];
        if (!to || human.tasks[drag.task].path[drag.at] === to) return;
        replaceAt(human, drag.task, drag.at, to);
        moved = drag.human;
        store(); draw();
        const now = performance.now();
        if (now - drag.sent > 120) { drag.sent = now; simulate(1); }
      });
      drawing.map.addEventListener("pointerup", function () { if (drag) { drag = null; changed(); } });
    }

    /* lanes on a clock */
    function seconds(human, task) {
      let length = 0;
      task.path.forEach(function (name, k) { const a = k && position(human, task.path[k - 1]), b = position(human, name); if (a && b) length += Math.hypot(a[0] - b[0], a[1] - b[1]); });
      return { walk: length / human.speed_m_s, stand: task.pauses.reduce(function (sum, pause) { return sum + pause.duration_s; }, 0) };
    }
    function drawLanes() {
      lanes.textContent = "";
      const limit = scenario.mission.route.time_limit_s, width = Math.max(300, left.clientWidth), x0 = 78, row = 30, high = 26 + row * Math.max(1, people().length);
      const box = svg(lanes, "svg", { viewBox: "0 0 " + width + " " + high, width: width, height: high, role: "img", "aria-label": "Tasks of the people over the time limit of " + limit + " s" });
      const px = function (t) { return x0 + (width - x0 - 8) * Math.min(1, t / limit); };
      for (let t = 0; t <= limit; t += limit > 60 ? 20 : 5) { svg(box, "line", { class: "rp-grid", x1: px(t), x2: px(t), y1: 0, y2: high - 18 }); svg(box, "text", { class: "st-axis", x: px(t), y: high - 4, "text-anchor": "middle" }, t + " s"); }
      people().forEach(function (human, k) {
        const y = k * row + 2, label = svg(box, "text", { class: "st-lane-name", x: 0, y: y + 18, fill: colour(k) }, human.name);
        label.addEventListener("click", function () { choose(k); });
        let t = human.start_delay_s, round = 0;
        while (t < limit && human.tasks.length && round++ < 200) {
          const task = human.tasks[(round - 1) % human.tasks.length], took = seconds(human, task);
          if (took.walk + took.stand <= 0) break;
          const bar0 = svg(box, "rect", { class: "st-lane" + (k === chosen ? " st-chosen" : ""), fill: colour(k), x: px(t), y: y, width: Math.max(1, px(t + took.walk) - px(t) - 1), height: row - 8, rx: 3 });
          svg(bar0, "title", {}, task.name + ", from " + t.toFixed(1) + " s");
          bar0.addEventListener("click", function () { choose(k); });
          if (took.stand) svg(box, "rect", { class: "st-stand", x: px(t + took.walk), y: y, width: Math.max(1, px(t + took.walk + took.stand) - px(t + took.walk)), height: row - 8 });
          t += took.walk + took.stand;
          if (!human.cyclic && round >= human.tasks.length) break;
        }
      });
    }

    /* the chosen person */
    function choose(k) { chosen = k; show(); }
    function showPeople() {
      const active = document.activeElement, held = right.contains(active) && active.dataset.field;
      right.textContent = "";
      html(right, "h2", {}, "People");
      const tabs = html(right, "ul", { class: "st-names" });
      people().forEach(function (human, k) { studio.button(html(tabs, "li", {}), human.name, function () { choose(k); }, { class: "st-button st-small", "aria-pressed": k === chosen ? "true" : "false" }); });
      const human = people()[chosen];
      if (human) {
        const field = function (label, key, attributes) {
          const input = html(null, "input", Object.assign({ type: "number", value: human[key], "data-field": key }, attributes));
          function possible() { return input.value !== "" && !input.validity.rangeUnderflow && !input.validity.rangeOverflow; }
          input.addEventListener("input", function () { if (possible()) write(chosen + key, function () { people()[chosen][key] = +input.value; }); });
          input.addEventListener("change", function () {
            if (!possible()) say(label + ": expected a number from " + attributes.min + " to " + attributes.max + ".", true);
            writing = ""; showPeople();
          });
          studio.labelled(right, label, input);
        };
        field("Speed, m/s", "speed_m_s", { min: 0.1, max: 3, step: 0.05 });
        field("Starts after, s", "start_delay_s", { min: 0, max: 600, step: 0.5 });
        const manner = html(null, "select", { "data-field": "behaviour" });
        data.behaviours.forEach(function (each) { const option = html(manner, "option", { value: each }, each); option.selected = each === human.behaviour; });
        manner.addEventListener("change", function () { edit(function () { people()[chosen].behaviour = manner.value; }); });
        studio.labelled(right, "Reacts to the robot", manner);
        html(right, "h3", {}, "Tasks");
        const list = html(right, "ol", { class: "small st-tasks" });
        human.tasks.forEach(function (task, t) {
          const item = html(list, "li", {}), last = task.path.length - 1;
          html(item, "span", {}, task.name + " ");
          const input = html(item, "input", { value: task.path[last], "aria-label": "Waypoint where task " + (t + 1) + " ends", list: "st-waypoints", autocomplete: "off", "data-field": "end" + t });
          typed.field(input, human.name + " ends " + t, function (to) {
            const known = where.has(to);
            if (known) edit(function () { replaceAt(people()[chosen], t, last, to); }); else say("There is no waypoint " + to + ".", true);
            return Promise.resolve(known);
          });
        });
        studio.button(right, "Remove " + human.name, function () { edit(function () { people().splice(chosen, 1); chosen = Math.max(0, chosen - 1); }); }, { class: "st-button st-danger" });
      }
      html(right, "h3", {}, "Add a person");
      const list = html(right, "datalist", { id: "st-waypoints" });
      data.waypoints.forEach(function (w) { html(list, "option", { value: w[0] }); });
      const from = html(null, "input", { list: "st-waypoints", autocomplete: "off", "data-field": "from" }), to = html(null, "input", { list: "st-waypoints", autocomplete: "off", "data-field": "to" });
      studio.labelled(right, "From waypoint", from); studio.labelled(right, "To waypoint", to);
      typed.field(from, "from"); typed.field(to, "to");
      studio.button(right, "Add", function () {
        const before = people().length;
        keep();
        simulate(1, { stops: [from.value.trim(), to.value.trim()] }).then(function () {
          if (people().length === before) return;
          chosen = before; typed.set("from", null); typed.set("to", null); show();
        });
      });
      if (held) { const again = right.querySelector('[data-field="' + held + '"]'); if (again) again.focus(); }
    }
    function showVerdict() {
      verdict.textContent = "";
      if (differs()) { compare(); html(verdict, "span", { class: "st-before" }, "before " + before + ", now " + (tried && tried.problems.length ? "not possible:" : "")); }
      if (!tried) { html(verdict, "span", { class: "soft" }, "Preparing the simulator; the first time takes a minute or two\u2026"); return; }
      if (tried.problems.length) {
        const list = html(verdict, "ul", { class: "st-wrong" });
        tried.problems.forEach(function (problem) { html(list, "li", {}, problem); });
        return;
      }
      if (tried.runs > 1) {
        const share = tried.violations / tried.runs;
        html(verdict, "strong", { class: "st-share" + (share > 0 ? " st-wrong" : "") }, tried.violations + " of " + tried.runs + " runs violate " + tried.requirement);
        const dots = html(verdict, "span", { class: "st-dots", "aria-hidden": "true" });
        tried.objectives.forEach(function (value, k) { html(dots, "span", { class: tried.violated[k] ? "st-dot st-dot-bad" : "st-dot", title: value === null ? "no value" : value.toPrecision(3) + " " + tried.unit }); });
      } else html(verdict, "strong", { class: "st-share" }, "One run: " + (tried.objectives[0] === null ? "no value" : tried.objectives[0].toPrecision(3) + " " + tried.unit) + (tried.limit !== null ? " (limit " + +tried.limit.toPrecision(3) + " " + tried.unit + ")" : "") + "\u2026");
      html(verdict, "span", { class: "soft small" }, tried.outcome + ", after " + tried.duration_s.toFixed(1) + " s");
      if (tried.repairs.length && !status.textContent) html(verdict, "span", { class: "soft small" }, "Repaired: " + tried.repairs.join("; "));
    }
    function show() {
      if (!drawing) { skeleton.remove(); startMap(); }
      undo.disabled = !done.length; redo.disabled = !undone.length;
      discard.disabled = !differs();
      draw(); drawLanes(); showVerdict();
      const active = document.activeElement;  // who writes in a field is not disturbed
      if (!drag && !(right.contains(active) && active.tagName === "INPUT" && active.value !== active.defaultValue)) showPeople();
    }
    function take(found) {
      data = found; scenario = found.scenario; where = new Map(found.waypoints.map(function (w) { return [w[0], [w[1], w[2]]]; })); tried = null;
      select.textContent = "";
      Object.keys(found.requirements).forEach(function (name) { const option = html(select, "option", { value: name }, name + ": " + found.requirements[name]); option.selected = name === requirement; });
      show();
      if (found.draft) say("Changes that were not saved are shown.");
      element.dataset.ready = "true";
      simulate(1);
    }

    /* save */
    const saving = html(element, "div", { class: "st-saving" });
    html(saving, "h2", {}, "Save");
    const file = studio.labelled(saving, "As a file", html(null, "input", { value: "scenarios/edited.json", autocomplete: "off" }));
    function saved(found) { say(found.said); }
    studio.button(saving, "Save the scenario", function () { send("/data/scenario-save", question({ save_as: file.value })).then(saved).catch(fail); });
    const suite = studio.labelled(saving, "In the suite", html(null, "input", { value: source.suite || "suite", autocomplete: "off" })), title = studio.labelled(saving, "Title of the case", html(null, "input", { autocomplete: "off" }));
    studio.button(saving, "Add to the suite", function () { send("/data/scenario-save", question({ add_to: suite.value, title: title.value })).then(saved).catch(fail); });

    typed.load().then(function () {
      [["file", file], ["suite", suite], ["title", title]].forEach(function (each) { typed.field(each[1], each[0]); });
      return ask("/data/scenario" + query);
    }).then(take).catch(fail);
  };
})(window);
