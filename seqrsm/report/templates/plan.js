(function () {
  "use strict";
  document.querySelectorAll(".planner").forEach(function (box) {
    var holder = document.createElement("div");
    holder.innerHTML = "<svg></svg>";
    // On a narrow screen the drawing is as narrow, so that its words keep their size.
    var W = Math.max(320, Math.min(640, box.querySelector(".curve").clientWidth || 640));
    var NS = holder.firstChild.namespaceURI, H = 300, LEFT = 60, BOTTOM = 40, TOP = 24, RIGHT = 16;
    var data = JSON.parse(box.querySelector("script").textContent), unit = data.unit ? " " + data.unit : "", head = data.unit ? " [" + data.unit + "]" : "";
    var most = data.most, controls = box.querySelector(".controls"), fields = {};
    function add(parent, name, attributes, text) {
      var svg = parent.namespaceURI === NS || name === "svg";
      var node = svg ? document.createElementNS(NS, name) : document.createElement(name);
      Object.keys(attributes).forEach(function (key) { node.setAttribute(key, attributes[key]); });
      if (text !== undefined) { node.textContent = text; }
      parent.appendChild(node);
      return node;
    }
    function short(value) { return Number(value.toPrecision(3)).toString().replace("-", "\u2212"); }
    function control(key, label, value, attributes) {
      var id = "plan-" + key, line = add(controls, "p", {});
      add(line, "label", { "for": id }, label + " ");
      var field = add(line, "input", Object.assign({ id: id }, attributes));
      if (field.type === "checkbox") { field.checked = value; } else { field.value = value; }
      field.addEventListener("input", draw);
      fields[key] = field;
    }
    var guess = data.half_width / 2;
    data.factors.forEach(function (name, j) { control("factor-" + j, "vary " + data.labels[j], true, { type: "checkbox" }); });
    control("order", "second order (else first)", data.order === 2, { type: "checkbox" });
    control("runs", "runs", data.max_runs, { type: "range", min: 4, max: most, step: 1 });
    control("target", "target half-width" + head, data.half_width, { type: "number", min: 0, step: "any" });
    control("s", "run-to-run standard deviation" + head, short(data.s || guess), { type: "number", min: 0, step: "any" });
    control("cost", "cost of a run" + (data.cost_unit ? " [" + data.cost_unit + "]" : ""), data.cost,
      { type: "number", min: 0, step: "any" });
    // Straight over the logarithm of the degrees of freedom between the numbers that were simulated.
    function between(model, n, values) {
      var i = model.runs.findIndex(function (here) { return here >= n; });
      if (i < 0 || n < model.runs[0]) { return NaN; }
      if (model.runs[i] === n) { return values[i]; }
      var low = Math.log(model.runs[i - 1] - model.p), high = Math.log(model.runs[i] - model.p);
      return values[i - 1] + (values[i] - values[i - 1]) * (Math.log(n - model.p) - low) / (high - low);
    }
    // Surfaces were drawn in proportion to the standard deviation of a run.
    function halfWidth(model, n, s) { return between(model, n, model.half_widths) * s / (data.s || 1); }
    function loss(model, n, s) { return between(model, n, model.losses) * s / (data.s || 1); }
    function chosen() {
      var kept = data.factors.map(function (_, j) { return j; }).filter(function (j) { return fields["factor-" + j].checked; });
      var order = fields.order.checked ? 2 : 1;
      return data.models.find(function (one) { return one.order === order && one.kept.join() === kept.join(); });
    }
    function draw() {
      var model = chosen(), n = Number(fields.runs.value), s = Number(fields.s.value);
      var target = Number(fields.target.value), curve = box.querySelector(".curve");
      curve.textContent = "";
      if (!model) {
        box.querySelector(".said").textContent = "This set of factors was not computed: vary all, or all but one.";
        return;
      }
      var width = halfWidth(model, n, s), lost = loss(model, n, s), first = 0, i;
      for (i = Math.max(model.asked, 1); i <= most && !first; i += 1) { if (halfWidth(model, i, s) <= target) { first = i; } }
      fields.runs.setAttribute("aria-valuetext", n + " runs");
      box.querySelector(".said").textContent = n + " runs, " + model.p + " terms: " +
        (isFinite(width) ? "half-width \u00b1 " + short(width) + unit : "too few runs for a half-width") +
        (isNaN(lost) ? "" : "; expected loss " + short(lost) + unit) +
        "; cost " + short(n * Number(fields.cost.value)) + (data.cost_unit ? " " + data.cost_unit : "") +
        (first ? ". The target is reached with " + first + " runs or more" + (first === model.asked ? ", the fewest that the stop rule allows." : ".")
          : ". " + most + " runs do not reach the target: use fewer factors, first order, or a wider target.");
      var top = 1.1 * Math.max(target, Math.min(halfWidth(model, model.runs[0], s) || 0, 6 * target));
      var x = function (at) { return LEFT + (W - LEFT - RIGHT) * at / most; };
      var y = function (at) { return H - BOTTOM - (H - BOTTOM - TOP) * Math.min(at / top, 1); };
      var svg = add(curve, "svg", { viewBox: "0 0 " + W + " " + H, role: "img",
        "aria-label": "Half-width against the number of runs, " + box.querySelector(".said").textContent });
      add(svg, "path", { d: "M" + LEFT + " " + TOP + "V" + (H - BOTTOM) + "H" + (W - RIGHT), fill: "none",
        stroke: "var(--line)" });
      var points = [];
      for (i = model.runs[0]; i <= model.runs[model.runs.length - 1]; i += 1) { points.push(x(i).toFixed(1) + "," + y(halfWidth(model, i, s)).toFixed(1)); }
      add(svg, "polyline", { points: points.join(" "), fill: "none", stroke: "var(--blue)", "stroke-width": 2 });
      add(svg, "line", { x1: LEFT, x2: W - RIGHT, y1: y(target), y2: y(target), stroke: "var(--green)",
        "stroke-dasharray": "6 4" });
      add(svg, "line", { x1: x(n), x2: x(n), y1: TOP, y2: H - BOTTOM, stroke: "var(--orange)", "stroke-dasharray": "4 3" });
      [0, most / 2, most].forEach(function (at) {
        add(svg, "text", { x: x(at), y: H - BOTTOM + 16, "text-anchor": "middle" }, short(at));
      });
      [0, target, top].forEach(function (at) {
        add(svg, "text", { x: LEFT - 6, y: y(at) + 4, "text-anchor": "end" }, short(at));
      });
      add(svg, "text", { x: (LEFT + W) / 2, y: H - 6, "text-anchor": "middle" }, "runs");
      add(svg, "text", { x: LEFT - 6, y: TOP - 12 }, "half-width" + head + "; green: target, orange: runs chosen");
    }
    draw();
  });
})();
