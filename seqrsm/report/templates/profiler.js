(function () {
  "use strict";
  var holder = document.createElement("div");
  holder.innerHTML = "<svg></svg>";
  var NS = holder.firstChild.namespaceURI, W = 220, H = 150, BOTTOM = 26, TOP = 8, RIGHT = 8;
  function make(parent, name, attributes, text) {
    var node = document.createElementNS(parent.namespaceURI === NS || name === "svg" ? NS : parent.namespaceURI, name);
    Object.keys(attributes).forEach(function (key) { node.setAttribute(key, attributes[key]); });
    if (text !== undefined) { node.textContent = text; }
    parent.appendChild(node);
    return node;
  }
  document.querySelectorAll(".profiler").forEach(function (box, number) {
    var data = JSON.parse(box.querySelector("script").textContent), factors = data.factors, rows = data.rows;
    var at = factors.map(function (factor) { return factor.start; });
    var all = rows.filter(function (row) { return row[5]; });
    var pick = function (best, columns) {
      return best.apply(null, all.map(function (row) {
        return best.apply(null, columns.map(function (c) { return row[c] === null ? row[0] : row[c]; }));
      }));
    };
    // The mean's whole range and the intervals where the page begins decide the axis, so that curves can be told apart.
    var low = Math.min(pick(Math.min, [0]), row(at)[3] === null ? Infinity : row(at)[3]);
    var high = Math.max(pick(Math.max, [0]), row(at)[4] === null ? -Infinity : row(at)[4]);
    if (!(high > low)) { low -= 1; high += 1; }
    function row(place) {
      return rows[place.reduce(function (sum, i, j) { return sum * factors[j].values.length + i; }, 0)];
    }
    function y(value) {
      var share = (Math.min(Math.max(value, low), high) - low) / (high - low);
      return (H - BOTTOM - (H - BOTTOM - TOP) * share).toFixed(1);
    }
    function x(share) { return (left + (W - left - RIGHT) * share).toFixed(1); }
    // As in the text of the report: powers of ten in place of a long row of digits.
    function show(value) {
      var power = value === 0 ? 0 : Math.floor(Math.log10(Math.abs(value))), places = data.places;
      var text = Math.abs(value) < 1e7 && places <= 6 ? value.toFixed(Math.max(places, 0)) :
        (value / Math.pow(10, power)).toFixed(Math.max(power + places, 0)) + " \u00d7 10" +
        String(power).replace(/./g, function (sign) { return "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"["-0123456789".indexOf(sign)]; });
      return text.replace("-", "\u2212");
    }
    var left = Math.max(44, 8 + 6 * Math.max(show(low).length, show(high).length));
    var output = make(box, "p", { "aria-live": "polite", "class": "said" });
    var grid = make(box, "div", { "class": "panels" });
    var panels = factors.map(function (factor, j) {
      var panel = make(grid, "div", { "class": "panel" }), id = "profile-" + number + "-" + j;
      make(panel, "label", { "for": id }, factor.label);
      var slider = make(panel, "input", { id: id, type: "range", min: 0, max: factor.values.length - 1, step: 1 });
      slider.value = at[j];
      // From the first value to the last of the plot below; the knob is 16 px wide.
      var first = x(factor.x[0]), last = x(factor.x[factor.x.length - 1]);
      slider.style.marginLeft = "calc(" + 100 * first / W + "% - 8px)";
      slider.style.width = "calc(" + 100 * (last - first) / W + "% + 16px)";
      var svg = make(panel, "svg", { viewBox: "0 0 " + W + " " + H, role: "img" });
      slider.addEventListener("input", function () { at[j] = Number(slider.value); draw(); });
      return { slider: slider, svg: svg };
    });
    var back = make(box, "button", { type: "button" }, box.getAttribute("data-start"));
    back.addEventListener("click", function () {
      at = factors.map(function (factor) { return factor.start; });
      panels.forEach(function (panel, j) { panel.slider.value = at[j]; });
      draw();
    });
    function draw() {
      var here = row(at), unit = data.unit ? " " + data.unit : "", text = "Mean score " + show(here[0]);
      if (here[1] !== null) {
        text += " (" + data.level + " confidence " + show(here[1]) + " to " + show(here[2]) + "; one future run " +
          show(here[3]) + " to " + show(here[4]) + ")";
      }
      text += unit + " at " + factors.map(function (factor, j) { return factor.label.replace(/ \[.*\]$/, "") + " " + factor.values[at[j]]; }).join(", ");
      output.textContent = text + (here[5] ? "." : ": excluded by the constraints.");
      panels.forEach(function (panel, j) {
        var factor = factors[j], line = factor.values.map(function (_, i) {
          return row(at.map(function (old, k) { return k === j ? i : old; }));
        });
        panel.slider.setAttribute("aria-valuetext", factor.values[at[j]]);
        panel.svg.setAttribute("aria-label", factor.label + ": mean " + line.map(function (one, i) {
          return show(one[0]) + " at " + factor.values[i];
        }).join(", "));
        while (panel.svg.firstChild) { panel.svg.removeChild(panel.svg.firstChild); }
        [[3, 4, 0.16], [1, 2, 0.32]].forEach(function (band) {
          if (line[0][band[0]] === null) { return; }
          if (factor.levels) {  // nothing lies between two levels
            line.forEach(function (one, i) {
              make(panel.svg, "line", { x1: x(factor.x[i]), x2: x(factor.x[i]), y1: y(one[band[0]]), y2: y(one[band[1]]),
                stroke: "var(--blue)", "stroke-width": 7, opacity: band[2] });
            });
            return;
          }
          var up = line.map(function (one, i) { return x(factor.x[i]) + "," + y(one[band[1]]); });
          var down = line.map(function (one, i) { return x(factor.x[i]) + "," + y(one[band[0]]); }).reverse();
          make(panel.svg, "polygon", { points: up.concat(down).join(" "), fill: "var(--blue)", opacity: band[2] });
        });
        if (factor.levels) {
          line.forEach(function (one, i) {
            make(panel.svg, "circle", { cx: x(factor.x[i]), cy: y(one[0]), r: 4, fill: "var(--blue)" });
          });
        } else {
          make(panel.svg, "polyline", { fill: "none", stroke: "var(--blue)", "stroke-width": 2,
            points: line.map(function (one, i) { return x(factor.x[i]) + "," + y(one[0]); }).join(" ") });
        }
        // A sheet over what the constraints exclude, half way to the next allowed value.
        line.forEach(function (one, i) {
          if (one[5]) { return; }
          var from = x((factor.x[i] + factor.x[Math.max(i - 1, 0)]) / 2);
          var to = x((factor.x[i] + factor.x[Math.min(i + 1, line.length - 1)]) / 2);
          make(panel.svg, "rect", { x: from, y: TOP, width: to - from, height: H - BOTTOM - TOP, fill: "var(--paper)", opacity: 0.8,
            "shape-rendering": "crispEdges" });
        });
        make(panel.svg, "line", { x1: x(factor.x[at[j]]), x2: x(factor.x[at[j]]), y1: TOP, y2: H - BOTTOM,
          stroke: "var(--orange)", "stroke-dasharray": "4 3" });
        make(panel.svg, "path", { d: "M" + left + " " + TOP + "V" + (H - BOTTOM) + "H" + (W - RIGHT), fill: "none",
          stroke: "var(--line)" });
        [low, high].forEach(function (value) {
          make(panel.svg, "text", { x: left - 4, y: Number(y(value)) + 4, "text-anchor": "end" }, show(value));
        });
        make(panel.svg, "text", { x: (left + W) / 2, y: H - 8, "text-anchor": "middle" }, factor.values[at[j]]);
      });
    }
    draw();
  });
})();
