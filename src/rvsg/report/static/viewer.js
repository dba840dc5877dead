/*
 * The viewer of .rvsg files (rvsg/app/view.py): chosen, dropped, or named by ?file= on the same server.
 *
 * A file is data of a stranger. Of its page, the elements and attributes below are copied, one by one, and its JSON is
 * given to the replay; the policy of this page allows its own script alone, by its digest.
 */
(function () {
  "use strict";
  const LARGEST = RVSG_LARGEST, HTML = "http://www.w3.org/1999/xhtml", SVG = "http://www.w3.org/2000/svg";
  const TAGS = new Set(("main section nav header footer div p span b i strong em small a h1 h2 h3 h4 ul ol li table thead tbody tr th td details " +
    "summary figure figcaption article code pre button br svg g defs use path line polyline polygon rect circle ellipse text tspan title image").split(" "));
  const note = document.getElementById("note"), content = document.getElementById("content"), input = document.getElementById("file");

  function allowed(name, value) {
    if (/^on|^(form|action|ping|target|srcdoc|srcset|autofocus)/.test(name)) return false;
    return !/(^|:)(href|src|data)$/.test(name) || value.startsWith("#") || /^data:image\/png;/.test(value);
  }
  function copy(from, to) {
    from.childNodes.forEach(function (node) {
      if (node.nodeType === Node.TEXT_NODE) { to.appendChild(document.createTextNode(node.data)); return; }
      if (node.nodeType !== Node.ELEMENT_NODE || !TAGS.has(node.localName) || ![HTML, SVG].includes(node.namespaceURI)) return;
      const made = document.createElementNS(node.namespaceURI, node.localName);
      Array.from(node.attributes).forEach(function (each) { if (allowed(each.name, each.value.trim())) made.setAttribute(each.name, each.value); });
      copy(node, made);
      to.appendChild(made);
    });
  }
  async function unpacked(file) {
    const parts = [], reader = file.stream().pipeThrough(new DecompressionStream("gzip")).getReader();
    let size = 0;
    for (;;) {
      const piece = await reader.read().catch(function () { throw new Error(size ? "This .rvsg file is damaged or cut off. Copy it again." : "This is no .rvsg file. rvsg export --to view writes one."); });
      if (piece.done) return new Blob(parts).text();
      size += piece.value.length;
      if (size > LARGEST) { reader.cancel(); throw new Error("This unpacks to more than " + LARGEST / 1e6 + " MB, the most that a .rvsg file may have."); }
      parts.push(piece.value);
    }
  }
  async function read(file) {
    let view = null;
    const text = await unpacked(file);
    try { view = JSON.parse(text); } catch (error) { /* told below */ }
    if (!view || view.format !== "rvsg-view") throw new Error("This is no .rvsg file. rvsg export --to view writes one.");
    if (view.version !== 1) throw new Error("This file has version " + view.version + ", made by RVSG " + view.made_by + "; this page reads version 1. Open it with the viewer of that version, or with rvsg report.");
    if (typeof view.page !== "string") throw new Error("This .rvsg file is damaged: it holds no page.");
    return new DOMParser().parseFromString(view.page, "text/html");
  }
  async function show(file, name) {
    note.textContent = "Opening " + name + "\u2026";
    const page = await read(file);
    if (window.replay) { window.replay.destroy(); window.replay = window.traces = null; history.replaceState(null, "", location.search || location.pathname); }
    content.textContent = "";
    document.getElementById("style").textContent = Array.from(page.querySelectorAll("style"), function (each) { return each.textContent; }).join("\n");
    copy(page.body, content);
    if (page.getElementById("data")) {
      try { rvsgReplay.page(page); } catch (error) { throw new Error("This .rvsg file is damaged: its runs cannot be shown (" + error.message + ")."); }
    }
    document.title = page.title;
    note.textContent = name;
  }
  function open(file, name) { return show(file, name).catch(function (error) { content.textContent = ""; note.textContent = error.message; }); }

  input.addEventListener("change", function () { if (input.files.length) open(input.files[0], input.files[0].name); });
  document.addEventListener("dragover", function (event) { event.preventDefault(); document.body.classList.add("st-over"); });
  document.addEventListener("dragleave", function (event) { if (!event.relatedTarget) document.body.classList.remove("st-over"); });
  document.addEventListener("drop", function (event) {
    event.preventDefault(); document.body.classList.remove("st-over");
    if (event.dataTransfer.files.length) open(event.dataTransfer.files[0], event.dataTransfer.files[0].name);
  });
  const linked = new URLSearchParams(location.search).get("file");
  if (linked) {
    const address = new URL(linked, location.href);
    if (address.origin !== location.origin || address.protocol === "file:") note.textContent = "Only files of the same server open by ?file=. Download this one and drop it here.";
    else fetch(address).then(function (found) { if (!found.ok) throw new Error(); return found.blob(); }).then(function (file) { return open(file, linked); }, function () { note.textContent = "There is no file at " + linked + "."; });
  }
})();
