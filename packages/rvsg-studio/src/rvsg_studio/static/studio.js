/*
 * What the pages of the studio need beside NiceGUI: it mounts the replay of the static report, and the editors.
 *
 * An element with data-studio="NAME" is given to the part of that name when it appears, with its other data-*
 * attributes as settings. Text from data is only ever set with textContent or as an attribute.
 */
(function (root) {
  "use strict";
  const parts = {}, html = root.rvsgReplay.html;

  async function answer(response) {
    if (response.status === 403) throw new Error("The studio does not know this page. Open the address that it printed; what you typed is kept.");
    const value = await response.json();
    if (!response.ok) throw new Error(value.error || "The studio answered " + response.status + ".");
    return value;
  }
  function silent() { throw new Error("The studio does not answer. Start it again and open the address that it prints."); }
  function request(address, how) { return fetch(address, Object.assign({ credentials: "same-origin" }, how)).catch(silent).then(answer); }
  /** Ask for data; an Error says why there is none. */
  function ask(address) { return request(address, {}); }
  /** Send a change or a long question. */
  function send(address, value) { return request(address, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(value) }); }
  /** Return a function that sends values one at a time; of those that come meanwhile only the last is sent. */
  function latest(act) {
    let busy = false, waiting = null;
    function next() {
      if (busy || !waiting) return;
      const given = waiting;
      busy = true; waiting = null;
      act.apply(null, given).then(function () { busy = false; next(); });
    }
    return function () { waiting = Array.from(arguments); next(); };
  }
  /**
   * What is typed on a page and not stored elsewhere yet: sent with every keystroke, given back after a restart.
   * `fail` gets the Error where that does not work.
   */
  function typing(page, fail) {
    let kept = {}, unsent = {};
    const committing = new Set();
    const flush = latest(function () {
      const fields = unsent;
      unsent = {};
      return send("/data/typed-keep", { page: page, fields: fields }).catch(function (error) { unsent = Object.assign(fields, unsent); fail(error); });
    });
    function set(key, value) {
      if (value === null ? kept[key] === undefined : kept[key] === value) return;
      if (value === null) delete kept[key]; else kept[key] = value;
      unsent[key] = value;
      flush();
    }
    return {
      load: function () { return ask("/data/typed?page=" + encodeURIComponent(page)).then(function (found) { kept = found; }); },
      keys: function () { return Object.keys(kept); },
      get: function (key) { return kept[key]; },
      set: set,
      /** Keep what is typed in a field until `commit`, which returns a promise of whether it worked, has stored it. */
      field: function (node, key, commit) {
        const stored = node.value;
        let sent = stored;
        if (kept[key] !== undefined && kept[key] !== stored && !committing.has(key)) {
          node.value = kept[key];
          if (commit) { node.classList.add("st-typed"); node.title = "Typed, and not stored yet: press Enter"; }
        }
        node.addEventListener("input", function () { set(key, node.value); });
        function store() {
          if (node.value === stored) return set(key, null);
          if (node.value === sent) return;
          const value = sent = node.value;
          committing.add(key);
          commit(value).then(function (worked) { committing.delete(key); if (!worked) sent = stored; else if (kept[key] === value) set(key, null); });
        }
        if (!commit) return node;
        node.addEventListener("change", store);
        if (node.tagName === "TEXTAREA") node.addEventListener("blur", function () { if (node.classList.contains("st-typed")) store(); });
        node.addEventListener("keydown", function (event) { if (event.key === "Enter" && node.tagName === "INPUT") store(); });
        return node;
      },
    };
  }
  /** Let other tabs know of a change to something: `changed` is called there, once they are not `busy`; returns what tells them. */
  function shared(key, busy, changed) {
    const channel = new BroadcastChannel("rvsg-studio:" + key);
    let waiting = 0;
    function take() { if (busy()) waiting = setTimeout(take, 500); else { waiting = 0; changed(); } }
    channel.onmessage = function () { if (!waiting) take(); };
    return function () { channel.postMessage(""); };
  }
  /* A page that takes long to come shows that at once: the style waits 300 ms. */
  root.addEventListener("beforeunload", function () { document.documentElement.classList.add("st-leaving"); });
  root.addEventListener("pageshow", function () { document.documentElement.classList.remove("st-leaving"); });

  /* Edit a finding in its own panes: a click on data-edit shows the editor there, another the replay again. */
  document.addEventListener("click", function (event) {
    const link = event.target.closest && event.target.closest("[data-edit]");
    if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
    const panes = document.querySelector(".st-panes");
    event.preventDefault();
    if (!panes.querySelector(".st-pane-editor")) {
      const pane = html(panes, "section", { class: "st-pane-editor", "aria-label": "Editor" });
      html(pane, "div", { "data-studio": "scenario", "data-source": link.dataset.edit, "data-before": link.dataset.before, "data-requirement": link.dataset.requirement, id: "editor" });
    }
    link.textContent = panes.classList.toggle("st-editing") ? "Replay" : "Edit";
  });
  function wrong(element, error) {
    element.textContent = "";
    html(element, "p", { class: "st-message st-wrong" }, error.message);
  }

  /** Let a run of a replay be simulated again with everything recorded, and show that as layers. */
  function tracing(replay, source) {
    const traces = rvsgReplay.traces(replay, {}), make = html(replay.tools, "button", { type: "button", class: "st-button st-small" }), note = html(replay.tools, "span", { role: "status", class: "rp-note" });
    let busy = null;
    function show() {
      const run = replay.state().run, done = traces.runs().includes(run);
      make.textContent = busy === run ? "Tracing\u2026" : done ? "This run is traced" : "Trace this run: lidar, costmaps, plans, recoveries";
      make.disabled = done || busy !== null;
    }
    make.addEventListener("click", function () {
      const run = busy = replay.state().run;
      note.textContent = ""; show();
      send("/data/trace", Object.assign({ run: run }, source)).then(traces.add).catch(function (error) { note.textContent = error.message; })
        .then(function () { busy = null; show(); });
    });
    replay.element.addEventListener("replaychange", function () { note.textContent = ""; show(); });
    show();
  }

  /** List the runs of a replay, those of a configuration together, the worst first; the chosen one is marked. */
  function listRuns(box, data, replay) {
    const buttons = {};
    box.textContent = "";
    data.groups.forEach(function (group) {
      html(box, "h2", { class: "st-minor" }, group.label);
      const list = html(box, "ol", { class: "st-run-list" });
      group.runs.forEach(function (run) {
        const judged = run.objective !== null, marks = (run.violated ? "\u2715" : judged ? "\u2713" : "") + ((run.lanes.contact || []).length ? " \u25cf" : "") + (run.arrived ? "" : " \u25f7");
        const said = [run.said, run.violated ? "violated" : judged ? "not violated" : "not judged"].concat((run.lanes.contact || []).length ? ["contact"] : [], run.arrived ? [] : ["did not arrive"]).join(", ");
        const made = html(html(list, "li", {}), "button", { type: "button", title: said + ", seed " + run.seed, "aria-label": said + ", seed " + run.seed, class: run.violated ? "st-wrong" : "" }, marks + " " + run.said);
        made.addEventListener("click", function () { replay.pause(); replay.select(run.id); });
        buttons[run.id] = buttons[run.id] || made;
      });
    });
    function mark() {
      const chosen = replay.state().run;
      for (const id in buttons) buttons[id].setAttribute("aria-pressed", id === chosen ? "true" : "false");
      if (buttons[chosen]) buttons[chosen].scrollIntoView({ block: "nearest" });
    }
    html(box, "p", { class: "small soft" }, "\u2715 violated, \u25cf contact, \u25f7 did not arrive. [ and ] choose the run.");
    replay.element.addEventListener("replaychange", mark);
  }

  /* Tabs: buttons with role=tab, each with the panel that it controls. */
  parts.tabs = function (element) {
    const tabs = Array.from(element.querySelectorAll("[role=tab]"));
    function choose(tab) {
      tabs.forEach(function (each) {
        each.setAttribute("aria-selected", each === tab ? "true" : "false");
        each.tabIndex = each === tab ? 0 : -1;
        document.getElementById(each.getAttribute("aria-controls")).hidden = each !== tab;
      });
    }
    tabs.forEach(function (tab, k) {
      tab.addEventListener("click", function () { choose(tab); });
      tab.addEventListener("keydown", function (event) {
        const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (!by) return;
        const next = tabs[(k + by + tabs.length) % tabs.length];
        event.preventDefault(); event.stopPropagation(); choose(next); next.focus();
      });
    });
    choose(tabs[0]);
  };

  /* The replay of the static report: data-url gives its data, data-play starts it, data-keys="page" listens everywhere,
     data-stage and data-runs name the elements that hold the map and the list of runs, data-run and data-t what is shown first,
     data-both lays the second run over the first, data-trace (JSON) names the campaign or the files of runs of which a
     run can be traced. */
  parts.replay = function (element) {
    let shown = null, wanted = 0;
    const host = html(element, "div", {});
    function load(address) {
      const turn = ++wanted;
      if (!shown) html(host, "p", { class: "st-wait st-skeleton" }, "Loading the replay\u2026");
      return ask(address).then(function (data) {
        if (turn !== wanted) return;
        if (shown) shown.destroy();
        host.textContent = "";
        const given = element.dataset, stage = given.stage && document.getElementById(given.stage);
        shown = rvsgReplay.mount(host, data, { keys: given.keys === "page" ? document : host, stage: stage || undefined, run: given.run, t: given.t && +given.t });
        element.replay = shown; element.replayData = data;
        if (!shown) return;
        if (given.runs) listRuns(document.getElementById(given.runs), data, shown);
        if (element.dataset.trace) tracing(shown, JSON.parse(element.dataset.trace));
        return shown.ready().then(function () {
          if (element.dataset.both === undefined) return null;
          const runs = data.groups[0].runs;
          return shown.select(runs[0].id, 0).then(function () { return shown.compare(runs[1].id); });
        }).then(function () {
          if (element.dataset.play !== undefined && !root.matchMedia("(prefers-reduced-motion: reduce)").matches) { shown.seek(0); shown.play(); }
          element.dataset.ready = "true";
        });
      }).catch(function (error) { if (turn === wanted) wrong(host, error); });
    }
    new MutationObserver(function () { load(element.dataset.url); }).observe(element, { attributes: true, attributeFilter: ["data-url"] });
    if (element.dataset.url) load(element.dataset.url);
  };

  function start(element) {
    if (element.studioStarted || !parts[element.dataset.studio]) return;
    element.studioStarted = true;
    parts[element.dataset.studio](element);
  }
  function search(node) {
    if (node.nodeType !== 1) return;
    if (node.dataset.studio) start(node);
    node.querySelectorAll("[data-studio]").forEach(start);
  }
  new MutationObserver(function (records) {
    records.forEach(function (record) { record.addedNodes.forEach(search); });
  }).observe(document.documentElement, { childList: true, subtree: true });

  root.studio = { parts: parts, ask: ask, send: send, request: request, latest: latest, typing: typing, shared: shared, html: html, wrong: wrong };
})(window);
