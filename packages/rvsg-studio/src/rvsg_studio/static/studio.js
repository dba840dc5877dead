/*
 * What the pages of the studio need beside NiceGUI: it mounts the replay of the static report, and the editors.
 *
 * An element with data-studio="NAME" is given to the part of that name when it appears, with its other data-*
 * attributes as settings. Text from data is only ever set with textContent or as an attribute.
 */
(function (root) {
  "use strict";
  const parts = {};

  function html(parent, tag, attributes, text) {
    const node = document.createElement(tag);
    for (const key in attributes || {}) node.setAttribute(key, attributes[key]);
    if (text !== undefined) node.textContent = text;
    if (parent) parent.appendChild(node);
    return node;
  }
  async function answer(response) {
    if (response.status === 403) throw new Error("The studio was restarted. Open the address that it printed; what you typed is kept.");
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

  /* The replay of the static report: data-url gives its data, data-play starts it, data-keys="page" listens everywhere,
     data-both lays the second run over the first, data-trace (JSON) names the campaign or the files of runs of which a
     run can be traced. */
  parts.replay = function (element) {
    let shown = null, wanted = 0;
    const host = html(element, "div", {});
    function load(address) {
      const turn = ++wanted;
      if (!shown) html(host, "p", { class: "st-wait" }, "Loading the replay\u2026");
      return ask(address).then(function (data) {
        if (turn !== wanted) return;
        if (shown) shown.destroy();
        host.textContent = "";
        shown = rvsgReplay.mount(host, data, { keys: element.dataset.keys === "page" ? document : host });
        element.replay = shown; element.replayData = data;
        if (!shown) return;
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

  root.studio = { parts: parts, ask: ask, send: send, request: request, latest: latest, typing: typing, html: html, wrong: wrong };
})(window);
