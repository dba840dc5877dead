/*
 * Parts of pages beside the editors: names that light up on a map, two replays on one clock, names proposed by a model.
 * See studio.js.
 */
(function (root) {
  "use strict";
  const studio = root.studio, parts = studio.parts, ask = studio.ask, send = studio.send, html = studio.html;
  const svg = studio.svg, button = studio.button, labelled = studio.labelled, plan = studio.plan;

  /** Names for areas that a model proposes; a person accepts them one by one. `editor` is that of the world. */
  studio.names = function (box, name, editor) {
    let named = null;
    const keepModel = studio.latest(function (asked) { return send("/data/names-model", { asked: asked }).then(function (kept) { named.asked = kept; }).catch(editor.fail); });
    function loadNames() {
      ask("/data/names" + "?world=" + encodeURIComponent(name)).then(function (found) { named = found; showNames(); if (found.state === "running" || found.state === "starting") setTimeout(loadNames, 1000); }).catch(editor.fail);
    }
    function showNames() {
      const open = box.querySelector("details"), was = !!(open && open.open), busy = named.state === "running" || named.state === "starting";
      box.textContent = "";
      html(box, "h2", {}, "Names by a model");
      const told = busy ? "The model is looking at the map\u2026" : named.state === "finished" && !named.names.length ? "No proposal is left. " + named.said : named.said;
      html(box, "p", { class: "small soft", role: "status" }, told);
      const list = html(box, "ul", { class: "st-list" });
      named.names.forEach(function (each) {
        const item = html(list, "li", {});
        html(item, "strong", {}, each.area + " \u2192 " + each.words + " ");
        html(item, "div", { class: "small" }, each.why);
        if (!each.door) button(item, "Show", function () { editor.choose("areas", each.area); }, { class: "st-button st-small", "aria-label": "Show " + each.area });
        button(item, "Accept", function () {
          const change = each.door ? editor.change("add door", each.door) : editor.change("change area", { name: each.area, values: each.values }, function () { editor.choose("areas", each.name); });
          change.then(loadNames);
        }, { class: "st-button st-small", "aria-label": "Accept " + each.name });
        button(item, "Drop", function () { send("/data/names-drop", { world: name, area: each.area }).then(function (found) { named = found; showNames(); }).catch(editor.fail); }, { class: "st-button st-small", "aria-label": "Drop " + each.name });
      });
      const more = html(box, "details", {}), asked = Object.assign({}, named.asked);
      more.open = was;
      html(more, "summary", {}, "Ask a model");
      [["Model", "model", "PROVIDER:NAME"], ["Server", "base_url", "of your own"], ["Budget in USD", "budget_usd", ""]].forEach(function (each) {
        const value = asked[each[1]], field = html(null, "input", { value: value === null ? "" : value, placeholder: each[2], autocomplete: "off" });
        labelled(more, each[0], field);
        field.addEventListener("input", function () { asked[each[1]] = each[1] === "budget_usd" ? (field.value === "" ? null : +field.value) : field.value; keepModel(asked); });
      });
      const photographs = labelled(more, "Photographs or plans", html(null, "input", { placeholder: "hall.jpg, plan.png in the studio's folder", autocomplete: "off" }));
      button(more, "Propose names", function () { send("/data/names-ask", { world: name, asked: asked, photographs: photographs.value }).then(function (found) { named = found; showNames(); loadNames(); }).catch(editor.fail); }).disabled = busy;
    }
    loadNames();
  };

  /* A key goes to what has it as data-key: to a field, or to where a link leads. */
  document.addEventListener("keydown", function (event) {
    const plain = !event.ctrlKey && !event.metaKey && !event.altKey && !/^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName);
    const found = plain && Array.from(document.querySelectorAll("[data-key]")).find(function (each) { return each.dataset.key === event.key; });
    if (!found) return;
    event.preventDefault();
    if (found.tagName === "INPUT") found.focus(); else found.click();
  });

  /* A search in the page: of the elements data-of those stay that hold the words, and what they lie in (data-within). */
  parts.filter = function (element) {
    const field = labelled(element, "Search", html(null, "input", { type: "search", autocomplete: "off" })), count = html(element, "p", { class: "soft", role: "status" });
    function all(what, from) { return Array.from((from || document).querySelectorAll(what)); }
    function show() {
      const nodes = all(element.dataset.of), words = field.value.trim().toLowerCase();
      nodes.forEach(function (node) { node.style.display = node.textContent.toLowerCase().includes(words) ? "" : "none"; });
      const seen = nodes.filter(function (node) { return !node.style.display; });
      all(element.dataset.within).forEach(function (box) { box.style.display = seen.some(function (node) { return box.contains(node); }) ? "" : "none"; });
      count.textContent = seen.length + " of " + nodes.length + " " + element.dataset.counted;
    }
    field.addEventListener("input", show);
    show();
  };

  function sent(file) { return studio.request("/data/file?name=" + encodeURIComponent(file.name), { method: "POST", headers: { "content-type": "application/octet-stream" }, body: file }); }
  /** Take the files that are chosen, or dropped on the page. */
  function receive(element, chosen, take) {
    function some(files) { if (files.length) take(files); }
    chosen.addEventListener("change", function () { some(chosen.files); });
    document.addEventListener("dragover", function (event) { event.preventDefault(); element.classList.add("st-over"); });
    document.addEventListener("dragleave", function (event) { if (!event.relatedTarget) element.classList.remove("st-over"); });
    document.addEventListener("drop", function (event) { event.preventDefault(); element.classList.remove("st-over"); some(event.dataTransfer.files); });
  }

  /* Files that are dropped on the page, or chosen; data-accept says what they end in. They wait in the studio. */
  parts.drop = function (element) {
    const chosen = labelled(element, "Files", html(null, "input", { type: "file", multiple: "", accept: element.dataset.accept }));
    const told = html(element, "p", { class: "soft", role: "status" });
    const again = button(element, "Remove the files", function () { send("/data/files-forget", {}).then(show).catch(fail); }, { class: "st-button st-small" });
    function fail(error) { told.textContent = error.message; told.classList.add("st-wrong"); }
    function show(found) {
      told.textContent = found.names.length ? "Received: " + found.names.join(", ") : "";
      told.classList.remove("st-wrong");
      again.hidden = !found.names.length;
      const folder = document.getElementById("folder"), map = found.names.find(function (each) { return /\.(ya?ml|sdf|world)$/i.test(each); });
      if (map && !folder.value) { folder.value = map.replace(/\.[^.]*$/, ""); folder.dispatchEvent(new Event("input")); }
    }
    function take(files) {
      told.textContent = "Receiving\u2026";
      Array.from(files).reduce(function (before, file) {
        return before.then(function () { return sent(file).then(show); });
      }, Promise.resolve()).catch(fail);
    }
    receive(element, chosen, take);
    ask("/data/files").then(show).catch(fail);
    element.dataset.ready = "true";
  };

  /* A file that is dropped on the page, or chosen, and the page that shows what it holds: data-label says what for,
     data-accept what it ends in, data-most how many bytes it may have. */
  parts.view = function (element) {
    const chosen = labelled(element, element.dataset.label, html(null, "input", { type: "file", accept: element.dataset.accept }));
    const told = html(element, "p", { class: "st-wrong small", role: "status" });
    function take(files) {
      const file = files[0];
      told.textContent = "";
      if (file.size > +element.dataset.most) { told.textContent = file.name + " is too large to be sent. Copy it into the folder of the studio, and name it here."; return; }
      sent(file).then(function (found) { location.href = found.address; }, function (error) { told.textContent = error.message; });
      chosen.value = "";
    }
    receive(element, chosen, take);
    element.dataset.ready = "true";
  };

  /* A map on which the names of a text light up: buttons with data-name on the page. */
  parts.named = function (element) {
    ask("/data/world?world=" + encodeURIComponent(element.dataset.world)).then(function (data) {
      const drawing = plan(element, data.floor, "Map of " + data.title);
      data.areas.forEach(function (area) {
        svg(drawing.metres, "polygon", { class: "area kind-" + data.kinds.indexOf(area.kind), points: area.outline.map(function (p) { return p.join(","); }).join(" "), "data-area": area.name.toLowerCase() });
        const xs = area.outline.map(function (p) { return p[0]; }), ys = area.outline.map(function (p) { return p[1]; });
        const at = drawing.place((Math.min.apply(null, xs) + Math.max.apply(null, xs)) / 2, (Math.min.apply(null, ys) + Math.max.apply(null, ys)) / 2);
        svg(drawing.words, "text", { class: "area-name st-hidden", x: at[0], y: at[1], "font-size": 0.45, "data-area": area.name.toLowerCase() }, area.name);
      });
      function light(name) {
        element.querySelectorAll("[data-area]").forEach(function (node) {
          const on = node.getAttribute("data-area") === name;
          node.classList.toggle(node.tagName === "text" ? "st-hidden" : "st-chosen", node.tagName === "text" ? !on : on);
        });
      }
      ["pointerover", "focusin", "click"].forEach(function (kind) {
        document.addEventListener(kind, function (event) { const named = event.target.closest && event.target.closest("[data-name]"); if (named) light(named.dataset.name.toLowerCase()); });
      });
      element.dataset.ready = "true";
    }).catch(function (error) { root.studio.wrong(element, error); });
  };

  /* One clock for all replays of the page. */
  parts.together = function (element) {
    let playing = false, t = 0, last = null, frame = 0;
    const play = button(element, "Play both", function () { playing = !playing; last = null; play.textContent = playing ? "Pause both" : "Play both"; if (playing) root.requestAnimationFrame(tick); });
    const slider = html(element, "input", { type: "range", min: 0, max: 1, step: 0.1, value: 0, "aria-label": "Time in both runs" });
    const told = html(element, "span", { class: "soft" });
    function replays() { return Array.from(document.querySelectorAll('[data-studio="replay"]')).map(function (node) { return node.replay; }).filter(Boolean); }
    function end() { return Math.max.apply(null, replays().map(function (each) { return each.state().end; }).concat([0.1])); }
    function seek(to) { t = Math.min(to, end()); replays().forEach(function (each) { each.pause(); each.seek(t); }); slider.max = end(); slider.value = t; told.textContent = t.toFixed(1) + " s"; }
    function tick(stamp) {
      if (!playing) return;
      if (last !== null) seek(t + (stamp - last) / 1000);
      last = stamp; frame++;
      if (t >= end()) { play.click(); t = 0; } else root.requestAnimationFrame(tick);
    }
    slider.addEventListener("input", function () { seek(+slider.value); });
    /** Begin with both runs at the decisive moment of the first, on its seed where the second has that, too. */
    function begin() {
      const shown = Array.from(document.querySelectorAll('[data-studio="replay"]')), hosts = shown.filter(function (node) { return node.dataset.ready; });
      if (!hosts.length || hosts.length < shown.length) { setTimeout(begin, 100); return; }
      const first = hosts[0].replay.state(), runs = hosts.map(function (node) { return node.replayData.groups.flatMap(function (group) { return group.runs; }); });
      const seed = runs[0].find(function (run) { return run.id === first.run; }).seed, same = hosts.slice(1).map(function (node, k) {
        const run = runs[k + 1].find(function (each) { return each.seed === seed; });
        return run ? node.replay.select(run.id, first.t) : null;
      });
      Promise.all(same).then(function () { seek(first.t); element.dataset.ready = "true"; });
    }
    begin();
  };
})(window);
