/*
 * The editor of a world and the floor plan that the editors share; see studio.js.
 *
 * Every change goes to the studio at once, which writes it into the YAML of the world and answers with the world as it
 * is then. Text from data is only ever set with textContent, as a value or as an attribute.
 */
(function (root) {
  "use strict";
  const parts = root.studio.parts, ask = root.studio.ask, send = root.studio.send, html = root.studio.html, svg = root.rvsgReplay.svg;
  const SNAP_M = 0.25, NUDGE_M = 0.1;
  const SVG = "http://www.w3.org/2000/svg";
  function button(parent, text, act, attributes) {
    const made = html(parent, "button", Object.assign({ type: "button", class: "st-button" }, attributes || {}), text);
    made.addEventListener("click", act);
    return made;
  }
  function labelled(parent, text, node) {
    const label = html(parent, "label", { class: "st-field" });
    html(label, "span", { class: "st-label" }, text);
    label.appendChild(node);
    return node;
  }
  function round(v) { return Math.round(v * 100) / 100; }

  /** A floor plan that can be zoomed: `metres` is a group in world coordinates, `words` one in those of the page. */
  function plan(host, floor, label) {
    const map = svg(host, "svg", { class: "st-map", viewBox: floor.view_box, role: "img", "aria-label": label, tabindex: "0" });
    const read = new DOMParser().parseFromString('<svg xmlns="' + SVG + '"><style></style>' + floor.shapes + floor.names + "</svg>", "image/svg+xml").documentElement;
    Array.from(read.childNodes).forEach(function (node) { map.appendChild(document.importNode(node, true)); });
    map.querySelector("style").textContent = floor.style;
    const m = floor.matrix, metres = svg(map, "g", { class: "plan", transform: "matrix(" + m.join(" ") + ")" }), words = svg(map, "g", {});
    const whole = floor.view_box.split(" ").map(Number);
    function frame(box) { map.setAttribute("viewBox", box.join(" ")); map.dispatchEvent(new CustomEvent("framed")); }
    function zoom(factor, atX, atY) {
      const b = map.getAttribute("viewBox").split(" ").map(Number), w = Math.min(whole[2], b[2] / factor), h = Math.min(whole[3], b[3] / factor);
      frame([b[0] + (b[2] - w) * atX, b[1] + (b[3] - h) * atY, w, h]);
    }
    map.addEventListener("wheel", function (event) {
      if (document.activeElement !== map && !event.ctrlKey) return;  /* else the page scrolls */
      const box = map.getBoundingClientRect();
      event.preventDefault();
      zoom(event.deltaY > 0 ? 0.8 : 1.25, (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    }, { passive: false });
    function place(x, y) { return [m[0] * x + m[2] * y + m[4], m[1] * x + m[3] * y + m[5]]; }
    return {
      map: map, metres: metres, words: words, place: place,
      /** Mark a world point by a disc with a letter or a number in it. */
      mark: function (x, y, text, style) {
        const p = place(x, y), g = svg(words, "g", { class: style });
        svg(g, "circle", { cx: p[0], cy: p[1], r: 0.3 }); svg(g, "text", { x: p[0], y: p[1], "font-size": 0.36 }, text);
        return g;
      },
      /** World coordinates of a pointer. */
      at: function (event) { const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(metres.getScreenCTM().inverse()); return [p.x, p.y]; },
      /** Metres that a pixel is now. */
      pixel: function () { const c = map.getScreenCTM(); return 1 / Math.hypot(c.a, c.b); },
      zoom: function (factor) { zoom(factor, 0.5, 0.5); },
      pan: function (dx, dy) { const b = map.getAttribute("viewBox").split(" ").map(Number), k = 1 / map.getScreenCTM().a; frame([b[0] - dx * k, b[1] - dy * k, b[2], b[3]]); },
      fit: function () { frame(whole); },
    };
  }

  parts.world = function (element) {
    const name = element.dataset.world, query = "?world=" + encodeURIComponent(name);
    let data = null, drawing = null, tool = "select", chosen = null, points = [], remarks = [], cross = null;
    const typed = root.studio.typing("world:" + name, fail), opened = Date.now().toString(36), drives = new Map();
    const status = html(element, "p", { class: "st-message", role: "status" });
    const tools = html(element, "div", { class: "st-actions", role: "toolbar", "aria-label": "Tools" });
    const body = html(element, "div", { class: "st-editor" });
    const left = html(body, "div", { class: "st-editor-map" }), right = html(body, "div", { class: "st-editor-side" });
    const skeleton = html(left, "div", { class: "st-skeleton st-tall", "aria-hidden": "true" });
    const help = html(left, "p", { class: "soft small" });
    const shared = root.studio.shared("world:" + name, function () { return drag || points.length || Array.from(right.querySelectorAll("input:focus, textarea:focus")).some(function (field) { return field.value !== field.defaultValue; }); }, function () { ask("/data/world" + query).then(take).catch(fail); });
    const selected = html(right, "section", { "aria-label": "Selected" });
    const lists = html(right, "div", {});

    function say(text, bad) { status.textContent = text; status.classList.toggle("st-wrong", !!bad); }
    function fail(error) { say(error.message, true); }
    function take(found) { data = found; if (chosen && !data[chosen.kind].some(function (each) { return each.name === chosen.name; })) chosen = null; show(); check(); }
    function load() { return typed.load().then(function () { return ask("/data/world" + query); }).then(take).then(again).then(function () { element.dataset.ready = "true"; }).catch(fail); }
    /** Make a change; the promise says whether it worked. */
    function change(what, values, then) {
      say("");
      return send("/data/world-edit", { world: name, change: Object.assign({ what: what }, values) }).then(function (found) { if (then) then(); take(found); shared(); return true; }).catch(function (error) { fail(error); return false; });
    }
    /** Take up what was drawn or typed, and not stored, when the page was closed. */
    function again() {
      const drawn = typed.get("points"), there = function (kind, which) { return data[kind].some(function (each) { return each.name === which; }); };
      typed.keys().forEach(function (key) {
        const parts = key.split("/"), kind = parts[0], which = parts.slice(1, -1).join("/");
        if (parts.length < 3) return;
        if (!there(kind, which)) typed.set(key, null);
        else if (!chosen) choose(kind, which);
      });
      if (drawn && data.editable && (!drawn.area || there("areas", drawn.area))) {
        if (drawn.area) choose("areas", drawn.area);
        setTool(drawn.tool); setPoints(drawn.points); cross = points[points.length - 1]; draw(); drawing.map.focus({ preventScroll: true });
      }
      const field = selected.querySelector(".st-typed");
      if (field) field.focus();
      if (typed.keys().length) say("What was typed or drawn last is not stored yet. Press Enter to store it.");
    }
    function step(which) { return send("/data/world-" + which, { world: name }).then(function (found) { say(which === "undo" ? "Undone." : "Made again."); take(found); shared(); }).catch(fail); }
    let checking = 0;
    function check() {
      const turn = ++checking;
      setTimeout(function () {
        if (turn !== checking) return;
        ask("/data/world-check" + query).then(function (found) { if (turn === checking) { remarks = found; showRemarks(); } }).catch(fail);
      }, 300);
    }

    /* tools */
    const KEYS = " By keyboard: arrow keys move the cross by 10 cm (Shift: 1 m), Space sets a point.";
    const HELP = {
      select: "Click an area to select it; drag it or its corners; double-click or F2 renames it; arrow keys move it by 10 cm (Shift: 1 m), Delete removes it. Drag the floor to move the map; after a click the wheel zooms it.",
      rectangle: "Drag from corner to corner. Edges snap to walls and things; hold Alt to place freely." + KEYS,
      polygon: "Click corner after corner; Enter or a click on the first corner closes it, Escape drops it." + KEYS,
      split: "Click two points: the selected area is cut along the line through them." + KEYS,
      route: "Click the start, places to pass, and the goal; Enter ends it, Escape drops it." + KEYS,
    };
    const toolButtons = {};
    [["select", "Select"], ["rectangle", "Rectangle"], ["polygon", "Polygon"], ["split", "Split"], ["route", "Route"]].forEach(function (each) {
      toolButtons[each[0]] = button(tools, each[1], function () { setTool(each[0]); if (drawing && tool !== "select") drawing.map.focus({ preventScroll: true }); }, { "aria-pressed": "false", "data-tool": each[0] });
    });
    const undo = button(tools, "Undo", function () { step("undo"); }), redo = button(tools, "Redo", function () { step("redo"); });
    button(tools, "+", function () { drawing.zoom(1.4); }, { "aria-label": "Zoom in" });
    button(tools, "\u2212", function () { drawing.zoom(1 / 1.4); }, { "aria-label": "Zoom out" });
    button(tools, "Whole map", function () { drawing.fit(); });
    function setTool(which) {
      if (which === "split" && !(chosen && chosen.kind === "areas")) { say("Select the area to split first."); which = "select"; }
      tool = which; cross = null; setPoints([]);
      for (const key in toolButtons) toolButtons[key].setAttribute("aria-pressed", key === which ? "true" : "false");
      help.textContent = HELP[which];
      if (data) drawDraft();
    }

    /* the map */
    function snapped(point, event) {
      if (event.altKey) return [round(point[0]), round(point[1])];
      let x = point[0], y = point[1], bx = SNAP_M, by = SNAP_M;
      data.edges.forEach(function (e) {
        if (Math.abs(e[0] - e[2]) < 0.02 && point[1] > Math.min(e[1], e[3]) - 1 && point[1] < Math.max(e[1], e[3]) + 1) {
          const d = Math.abs(point[0] - e[0]); if (d < bx) { bx = d; x = e[0]; }
        }
        if (Math.abs(e[1] - e[3]) < 0.02 && point[0] > Math.min(e[0], e[2]) - 1 && point[0] < Math.max(e[0], e[2]) + 1) {
          const d = Math.abs(point[1] - e[1]); if (d < by) { by = d; y = e[1]; }
        }
      });
      return [round(x), round(y)];
    }
    function box(area) {
      const xs = area.outline.map(function (p) { return p[0]; }), ys = area.outline.map(function (p) { return p[1]; });
      return [Math.min.apply(null, xs), Math.min.apply(null, ys), Math.max.apply(null, xs), Math.max.apply(null, ys)];
    }
    function isBox(area) {
      const b = box(area);
      return area.outline.length === 4 && area.outline.every(function (p) { return (p[0] === b[0] || p[0] === b[2]) && (p[1] === b[1] || p[1] === b[3]); });
    }
    function shape(area, outline) { const moved = { outline: outline }; return isBox(area) && isBox(moved) ? { rectangle: box(moved) } : { outline: outline }; }
    function find() { return chosen && data[chosen.kind].find(function (each) { return each.name === chosen.name; }); }
    function choose(kind, which, focus) {
      chosen = which === null ? null : { kind: kind, name: which };
      draw(); showSelected(); showLists();
      if (focus) { const field = selected.querySelector("input"); if (field) { field.focus(); field.select(); } }
    }
    function points_(outline) { return outline.map(function (p) { return p.join(","); }).join(" "); }

    let drag = null;
    function draw() {
      drawing.metres.textContent = ""; drawing.words.textContent = "";
      data.areas.forEach(function (area) {
        const on = chosen && chosen.kind === "areas" && chosen.name === area.name;
        const node = svg(drawing.metres, "polygon", { class: "area kind-" + data.kinds.indexOf(area.kind) + (on ? " st-chosen" : ""), points: points_(area.outline) });
        node.addEventListener("pointerdown", function (event) {
          if (tool !== "select" || event.button) return;
          event.stopPropagation();
          if (!on) choose("areas", area.name);  // drawn anew it would get no double click
          if (data.editable) drag = { area: area, from: drawing.at(event), outline: area.outline };
        });
        const b = box(area), p = drawing.place((b[0] + b[2]) / 2, (b[1] + b[3]) / 2);
        const size = Math.max(0.28, Math.min(0.6, 13 * drawing.pixel()));
        if (!on && area.name.length * size * 0.55 > 1.5 * Math.max(b[2] - b[0], b[3] - b[1])) return;
        svg(drawing.words, "text", { class: "area-name", x: p[0], y: p[1], "font-size": size }, area.name);
      });
      data.routes.forEach(function (route) {
        const on = chosen && chosen.kind === "routes" && chosen.name === route.name;
        const node = svg(drawing.metres, "polyline", { class: "st-route" + (on ? " st-chosen" : ""), points: points_(route.line) });
        node.addEventListener("pointerdown", function (event) { if (tool === "select") { event.stopPropagation(); choose("routes", route.name); } });
        if (on) [["start", "S"], ["goal", "G"]].forEach(function (end) { drawing.mark(route[end[0]][0], route[end[0]][1], end[1], "st-end"); });
      });
      const area = chosen && chosen.kind === "areas" && find();
      if (area && data.editable) area.outline.forEach(function (p, k) {
        const dot = svg(drawing.metres, "circle", { class: "st-handle", cx: p[0], cy: p[1], r: Math.max(0.08, 7 * drawing.pixel()) });
        dot.addEventListener("pointerdown", function (event) { event.stopPropagation(); drag = { area: area, corner: k, outline: area.outline, square: isBox(area) }; });
      });
      remarks.forEach(function (remark, k) {
        const where = placeOf(remark);
        if (!where) return;
        svg(drawing.mark(where[0], where[1], String(k + 1), "st-pin" + (remark.serious ? " st-bad" : "")), "title", {}, remark.message);
      });
      drawDraft();
    }
    function placeOf(remark) {
      const list = remark.key[0], entry = (list === "areas" || list === "routes") && data[list][remark.key[1]];
      if (!entry) return null;
      if (list === "areas") { const b = box(entry); return [b[2], b[3]]; }
      return remark.key[2] === "goal" ? entry.goal : entry.start;
    }
    let draft = null, mark = null;
    /** Points that are set stay set after a restart. */
    function setPoints(to) {
      points = to;
      typed.set("points", to.length ? { tool: tool, points: to, area: tool === "split" ? chosen.name : "" } : null);
    }
    function drawCross() {
      if (mark) mark.remove();
      mark = null;
      if (!cross) return;
      const r = 10 * drawing.pixel(), x = cross[0], y = cross[1];
      mark = svg(drawing.metres, "path", { class: "st-cross", d: "M" + (x - r) + "," + y + "H" + (x + r) + "M" + x + "," + (y - r) + "V" + (y + r), "stroke-width": 2 * drawing.pixel() });
    }
    function drawDraft(to) {
      drawCross();
      if (draft) draft.remove();
      draft = null;
      to = to || cross;
      const all = to ? points.concat([to]) : points;
      if (!all.length) return;
      let drawn = all;
      if (tool === "rectangle" && all.length > 1) drawn = [all[0], [all[1][0], all[0][1]], all[1], [all[0][0], all[1][1]], all[0]];
      draft = svg(drawing.metres, "polyline", { class: "st-draft", points: points_(drawn) });
    }
    function finish() {
      const made = points;
      if (tool === "polygon" && made.length > 2) create({ outline: made });
      else if (tool === "route" && made.length > 1) {
        const route = free("route", data.routes, "_");
        change("add route", { name: route, points: made }, ended(function () { chosen = { kind: "routes", name: route }; }));
      } else setTool("select");
    }
    /** After a drawing is stored: until then its points stay, so that nothing is lost where that fails. */
    function ended(then) { return function () { setTool("select"); then(); }; }
    function rectangle(a, b) {
      if (Math.abs(a[0] - b[0]) > 0.1 && Math.abs(a[1] - b[1]) > 0.1) create({ rectangle: [a[0], a[1], b[0], b[1]] });
      else setTool("select");
    }
    /** Set a point of what is drawn, by a click or at the cross. */
    function setPoint(at) {
      const first = points[0];
      if (tool === "polygon" && points.length > 2 && Math.hypot(first[0] - at[0], first[1] - at[1]) < 12 * drawing.pixel()) return finish();
      setPoints((tool === "rectangle" && points.length > 1 ? [] : points).concat([at]));
      drawDraft();
      if (tool === "rectangle" && points.length === 2) rectangle(points[0], points[1]);
      if (tool === "split" && points.length === 2) change("split area", { name: chosen.name, line: longer(points) }, ended(function () { chosen = null; })).then(function (worked) { if (!worked) setTool("select"); });
    }
    function free(word, entries, joint) { let k = 1; while (entries.some(function (each) { return each.name === word + joint + k; })) k++; return word + joint + k; }
    function create(outline) {
      const area = free("Area", data.areas, " ");
      change("add area", Object.assign({ name: area, kind: "area" }, outline), ended(function () { chosen = { kind: "areas", name: area }; })).then(function (worked) { if (worked) choose("areas", area, true); });
    }
    function startMap() {
      drawing = plan(left, data.floor, "Map of " + data.title);
      left.insertBefore(drawing.map, help);
      const map = drawing.map;
      map.addEventListener("framed", draw);
      map.addEventListener("pointerdown", function (event) {
        if (event.button) return;
        const at = snapped(drawing.at(event), event);
        if (tool === "select") { if (!drag) drag = { map: [event.clientX, event.clientY] }; }
        else if (!data.editable) say("A shipped world is not changed. Copy it first.");
        else if (tool === "rectangle") { cross = null; setPoints([at]); drag = { rectangle: true }; }
        else { cross = null; setPoint(at); }
        if (drag) map.setPointerCapture(event.pointerId);
        map.focus({ preventScroll: true });
      });
      map.addEventListener("pointermove", function (event) {
        const at = snapped(drawing.at(event), event);
        if (!drag) { if (points.length) drawDraft(at); return; }
        if (drag.map) { drawing.pan(event.clientX - drag.map[0], event.clientY - drag.map[1]); drag.map = [event.clientX, event.clientY]; return; }
        if (drag.rectangle) { drag.to = at; drawDraft(at); return; }
        if (drag.corner !== undefined) drag.outline = reshaped(drag, at);
        else {
          const free0 = drawing.at(event), first = drag.area.outline[0];
          const corner = snapped([first[0] + free0[0] - drag.from[0], first[1] + free0[1] - drag.from[1]], event);
          drag.outline = drag.area.outline.map(function (p) { return [round(p[0] + corner[0] - first[0]), round(p[1] + corner[1] - first[1])]; });
        }
        const node = drawing.metres.querySelector("polygon.st-chosen");
        if (node) node.setAttribute("points", points_(drag.outline));
      });
      map.addEventListener("pointerup", function () {
        const done = drag; drag = null;
        if (!done || done.map) return;
        if (done.rectangle) { rectangle(points[0], done.to || points[0]); return; }
        if (points_(done.outline) !== points_(done.area.outline)) change("change area", { name: done.area.name, values: shape(done.area, done.outline) });
      });
      map.addEventListener("dblclick", function () { if (tool === "select") rename(); else finish(); });
      map.addEventListener("keydown", onKey);
      element.addEventListener("keydown", function (event) {
        if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || event.target.tagName === "INPUT" || event.target.tagName === "TEXTAREA") return;
        event.preventDefault(); step(event.shiftKey ? "redo" : "undo");
      });
    }
    function longer(line) { const dx = line[1][0] - line[0][0], dy = line[1][1] - line[0][1]; return [[line[0][0] - dx * 50, line[0][1] - dy * 50], [line[1][0] + dx * 50, line[1][1] + dy * 50]]; }
    function reshaped(drag0, at) {
      const outline = drag0.area.outline, old = outline[drag0.corner];
      if (!drag0.square) return outline.map(function (p, k) { return k === drag0.corner ? at : p; });
      return outline.map(function (p) { return [p[0] === old[0] ? at[0] : p[0], p[1] === old[1] ? at[1] : p[1]]; });
    }
    /** The name of the selected area in a field on the map. */
    function rename() {
      const area = chosen && chosen.kind === "areas" && data.editable && find();
      if (!area) return;
      const b = box(area), p = new DOMPoint((b[0] + b[2]) / 2, (b[1] + b[3]) / 2).matrixTransform(drawing.metres.getScreenCTM()), at = left.getBoundingClientRect();
      const field = html(left, "input", { value: area.name, class: "st-inline-name", "aria-label": "New name of " + area.name, maxlength: 120, autocomplete: "off" });
      field.style.left = Math.max(0, Math.min(at.width - 180, p.x - at.left - 90)) + "px"; field.style.top = p.y - at.top - 19 + "px";
      let done = false;
      function end(store) {
        if (done) return;
        done = true; field.remove(); drawing.map.focus({ preventScroll: true });
        const to = field.value.trim();
        if (store && to !== area.name) change("change area", { name: area.name, values: { name: to } }, function () { chosen = { kind: "areas", name: to }; });
      }
      field.addEventListener("keydown", function (event) { if (event.key === "Enter" || event.key === "Escape") { event.stopPropagation(); end(event.key === "Enter"); } });
      field.addEventListener("blur", function () { end(true); });
      field.focus(); field.select();
    }
    let nudges = 0, nudging = null, moved = 0;
    /** Moves by arrow keys are sent as they come; those of one go are undone together. */
    const nudge = root.studio.latest(function (which, values, turn, together) {
      const told = { what: "change area", name: which, values: values };
      return send("/data/world-edit", { world: name, change: told, together: together }).then(function (found) { if (turn === moved) take(found); }).catch(fail);
    });
    function onKey(event) {
      const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key], by = event.shiftKey ? 1 : NUDGE_M;
      const area = chosen && chosen.kind === "areas" && data.editable && find();
      if (event.key === "Enter") finish();
      else if (event.key === "Escape") setTool("select");
      else if (tool !== "select" && data.editable && (move || event.key === " ")) byKeys(event, move, by);
      else if (area && event.key === "F2") rename();
      else if (area && event.key === "Delete") change("remove area", { name: area.name });
      else if (area && move) {
        area.outline = area.outline.map(function (p) { return [round(p[0] + move[0] * by), round(p[1] + move[1] * by)]; });
        draw();
        clearTimeout(nudging);
        nudging = setTimeout(function () { nudges++; }, 1500);
        nudge(area.name, shape(area, area.outline), ++moved, opened + "-" + nudges);
      } else return;
      event.preventDefault();
    }
    /** Draw with the keyboard: a cross is moved, and sets points. */
    function byKeys(event, move, by) {
      if (!cross) {
        const r = drawing.map.getBoundingClientRect(), p = new DOMPoint(r.left + r.width / 2, r.top + r.height / 2).matrixTransform(drawing.metres.getScreenCTM().inverse());
        cross = [round(p.x), round(p.y)];
      } else if (move) cross = [round(cross[0] + move[0] * by), round(cross[1] + move[1] * by)];
      if (event.key === " ") { cross = snapped(cross, event); setPoint(cross); } else drawDraft();
      if (cross) say("The cross is at " + cross[0] + ", " + cross[1] + " m.");
    }

    /* beside the map */
    const driver = { robot: "", stack: "" };
    /** Ask for the robot and the stack that drive: a name, or a file of the folder. */
    function askDriver(parent) {
      const row = html(parent, "div", { class: "st-numbers" });
      ["robot", "stack"].forEach(function (key) {
        const list = html(row, "datalist", { id: "st-" + key + "s" }), label = key === "robot" ? "Robot" : "Stack";
        data[key + "s"].forEach(function (each) { html(list, "option", { value: each }); });
        const made = labelled(row, label, html(null, "input", { value: driver[key], list: "st-" + key + "s", placeholder: "default", autocomplete: "off", "data-field": label }));
        made.addEventListener("change", function () { driver[key] = made.value.trim(); drives.clear(); showSelected(); });
      });
    }
    /** Have the simulator drive a route with nobody about, and say how long it takes. */
    function drive(route, told) {
      const key = JSON.stringify(route);
      if (!drives.has(key)) {
        told.textContent = "The simulator drives it\u2026";
        drives.set(key, send("/data/world-drive", Object.assign({ world: name, route: route.name }, driver)));
      }
      drives.get(key).then(function (run) {
        told.textContent = "With nobody about: " + run.outcome + ", after " + run.time_s.toFixed(1) + " s of " + route.time_limit_s + " s" + (run.touched_s.length ? "; it touches an obstacle " + (run.touched_s.length === 1 ? "once" : run.touched_s.length + " times") : "") + ".";
      }).catch(function (error) { drives.delete(key); told.textContent = error.message; });
    }
    function showSelected() {
      const held = selected.contains(document.activeElement) && document.activeElement.dataset.field;
      fillSelected();
      const field = held && selected.querySelector('[data-field="' + held + '"]');
      if (field) { field.focus(); if (field.select) field.select(); }
    }
    function fillSelected() {
      selected.textContent = "";
      const entry = find();
      if (!entry) return;
      function input(label, parent, value, commit, attributes) {
        const made = labelled(parent, label, html(null, "input", Object.assign({ value: value, autocomplete: "off", "data-field": label }, attributes)));
        if (data.editable) typed.field(made, [chosen.kind, entry.name, label].join("/"), function (v) { return put(commit(v)); }); else made.disabled = true;
      }
      html(selected, "h2", {}, chosen.kind === "areas" ? "Area" : "Route");
      const what = chosen.kind === "areas" ? "change area" : "change route";
      function put(values) { return change(what, { name: entry.name, values: values }, function () { if (values.name) chosen.name = values.name.trim(); }); }
      input("Name", selected, entry.name, function (v) { return { name: v }; }, { maxlength: 120 });
      if (chosen.kind === "areas") {
        const list = html(selected, "datalist", { id: "st-kinds" });
        data.known_kinds.forEach(function (kind) { html(list, "option", { value: kind }); });
        input("Kind", selected, entry.kind, function (v) { return { kind: v }; }, { list: "st-kinds" });
        input("Note", selected, entry.note, function (v) { return { note: v }; });
        if (isBox(entry)) {
          const numbers = html(selected, "div", { class: "st-numbers", role: "group", "aria-label": "Edges in metres" }), b = box(entry);
          ["x from", "y from", "x to", "y to"].forEach(function (label, k) {
            input(label, numbers, b[k], function (v) { const next = b.slice(); next[k] = +v; return { rectangle: next }; }, { type: "number", step: "0.05" });
          });
        }
        html(selected, "p", { class: "small soft" }, entry.waypoints.length ? "People work it from " + entry.waypoints.slice(0, 10).join(", ") + (entry.waypoints.length > 10 ? ", \u2026" : ".") : "No waypoint reaches it.");
        const row = html(selected, "p", { class: "st-actions" });
        if (data.editable) {
          const other = html(row, "select", { "aria-label": "Area to merge with" });
          data.areas.forEach(function (each) { if (each.name !== entry.name) html(other, "option", { value: each.name }, each.name); });
          button(row, "Merge", function () { change("merge areas", { name: entry.name, other: other.value }); });
          button(row, "Remove", function () { change("remove area", { name: entry.name }); }, { class: "st-button st-danger" });
        }
      } else {
        input("Purpose", selected, entry.purpose, function (v) { return { purpose: v }; });
        input("Time limit, s", selected, entry.time_limit_s, function (v) { return { time_limit_s: +v }; }, { type: "number", min: 1 });
        html(selected, "p", { class: "small" }, entry.length_m + " m long; narrowest place " + (entry.narrowest_m === null ? "unknown" : entry.narrowest_m + " m wide") + ".");
        askDriver(selected);
        drive(entry, html(selected, "p", { class: "small", role: "status" }));
        const row = html(selected, "p", { class: "st-actions" });
        if (data.editable) button(row, "Remove", function () { change("remove route", { name: entry.name }); }, { class: "st-button st-danger" });
      }
    }
    const remarkBox = html(lists, "section", { "aria-label": "What the check finds" }), nameBox = html(lists, "section", { "aria-label": "Names by a model" }), areaBox = html(lists, "section", {}), routeBox = html(lists, "section", {}), activityBox = html(lists, "section", {});
    function showRemarks() {
      remarkBox.textContent = "";
      html(remarkBox, "h2", {}, "Check: " + (remarks.length ? remarks.filter(function (r) { return r.serious; }).length + " wrong, " + remarks.filter(function (r) { return !r.serious; }).length + " suspicious" : "nothing is wrong"));
      const list = html(remarkBox, "ol", { class: "st-remarks" });
      remarks.forEach(function (remark) {
        const item = html(list, "li", { class: remark.serious ? "st-wrong" : "" });
        html(item, "span", {}, remark.message + " ");
        html(item, "span", { class: "small soft" }, remark.file + (remark.line ? ":" + remark.line : "") + " ");
        const entry = (remark.key[0] === "areas" || remark.key[0] === "routes") && data[remark.key[0]][remark.key[1]];
        if (entry) button(item, "Show", function () { choose(remark.key[0], entry.name, true); }, { class: "st-button st-small", "aria-label": "Show " + entry.name });
        if (remark.fix && data.editable)
          button(item, "Fix: " + remark.fix.label, function () { change(remark.fix.change.what, remark.fix.change, function () { chosen = null; }); }, { class: "st-button st-small" });
      });
      const drive = button(remarkBox, "Drive the routes, too", function () {
        drive.disabled = true; drive.textContent = "Driving and walking\u2026";
        const turn = ++checking;
        ask("/data/world-check" + query + "&drive=1&" + new URLSearchParams(driver)).then(function (found) { if (turn === checking) { remarks = found; showRemarks(); } }).catch(fail);
      }, { class: "st-button st-small", title: "The robot drives every route and a person walks every hop in the simulator" });
      if (data) draw();
    }
    function showLists() {
      [[areaBox, "areas", "Areas"], [routeBox, "routes", "Routes"]].forEach(function (each) {
        each[0].textContent = "";
        html(each[0], "h2", {}, each[2] + " (" + data[each[1]].length + ")");
        const list = html(each[0], "ul", { class: "st-names" });
        data[each[1]].forEach(function (entry) {
          const on = chosen && chosen.kind === each[1] && chosen.name === entry.name;
          button(html(list, "li", {}), entry.name, function () { choose(each[1], entry.name, true); }, { class: "st-button st-small", "aria-pressed": on ? "true" : "false" });
        });
      });
    }
    function showActivities() {
      activityBox.textContent = "";
      html(activityBox, "h2", {}, "Activities");
      const text = html(null, "textarea", { rows: 6 });
      text.value = data.activities.join("\n"); text.disabled = !data.editable;
      labelled(activityBox, "What people do here, one per line", text);
      typed.field(text, "activities", function (value) { return change("set activities", { values: value.split("\n") }); });
    }
    function show() {
      if (!drawing) { skeleton.remove(); startMap(); if (data.editable) root.studio.names(nameBox, name, { choose: choose, change: change, fail: fail }); }
      undo.disabled = !data.undo; redo.disabled = !data.redo;
      draw(); showSelected(); showLists(); showActivities();
    }
    setTool("select");
    load();
  };

  Object.assign(root.studio, { svg: svg, button: button, labelled: labelled, round: round, plan: plan });
})(window);
