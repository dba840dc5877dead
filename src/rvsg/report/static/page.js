/*
 * A report page: its replay with traces, its buttons to copy a command, its tables that sort and filter.
 *
 * `source` is the document whose JSON is shown: the page itself, or one that was read from a file.
 */
(function (root) {
  "use strict";
  root.rvsgReplay.page = function (source) {
    const data = JSON.parse(source.getElementById("data").textContent);
    const places = { map: document.getElementById("map"), stage: document.getElementById("stage"), address: true, keys: document };
    root.replay = root.rvsgReplay.mount(document.getElementById("replay"), data, Object.assign(places, data.opens));
    root.traces = root.rvsgReplay.traces(root.replay, { open: true });
    source.querySelectorAll("script.trace").forEach(function (each) { root.traces.add(each.textContent); });
    document.querySelectorAll("button.copy").forEach(function (button) {
      button.addEventListener("click", function () {
        const text = button.parentNode.querySelector("code").textContent;
        navigator.clipboard.writeText(text).then(function () { button.textContent = "copied"; }, function () { button.textContent = "select it"; });
      });
    });
    document.querySelectorAll("table.sorted").forEach(function (table) {
      const body = table.tBodies[0], filter = document.createElement("input"), label = document.createElement("label");
      label.className = "small soft filter"; label.textContent = "Filter ";
      label.appendChild(filter);
      table.parentNode.parentNode.insertBefore(label, table.parentNode);
      filter.addEventListener("input", function () {
        Array.from(body.rows).forEach(function (row) { row.hidden = !row.textContent.toLowerCase().includes(filter.value.toLowerCase()); });
      });
      Array.from(table.tHead.rows[0].cells).forEach(function (head, k) {
        const button = document.createElement("button");
        button.type = "button"; button.textContent = head.textContent;
        head.textContent = ""; head.appendChild(button);
        button.addEventListener("click", function () {
          const up = head.getAttribute("aria-sort") !== "ascending", key = function (row) { return row.cells[k].textContent.trim(); };
          Array.from(table.tHead.rows[0].cells).forEach(function (other) { other.removeAttribute("aria-sort"); });
          head.setAttribute("aria-sort", up ? "ascending" : "descending");
          Array.from(body.rows).sort(function (a, b) { return (up ? 1 : -1) * key(a).localeCompare(key(b), "en", { numeric: true }); }).forEach(function (row) { body.appendChild(row); });
        });
      });
    });
  };
})(window);
