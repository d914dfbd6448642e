"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const all = (what, from = document) => Array.from(from.querySelectorAll(what));
  const one = (id) => document.getElementById(id);
  // what is shown of one test, where the study has several
  let test = data.tests ? data.tests[0] : data;
  const state = { model: data.order[data.order.length - 1], picture: 0, view: 0, region: null, effect: null, flipped: false };
  let timer = null;

  const model = () => test.models[state.model];
  // plane pictures are one view; volumes are seen slice by slice
  const shot = () => (test.views.length ? `${state.picture}@${state.view}` : `${state.picture}`);
  const frame = () => test.frames[state.view], map = () => test.maps[state.view];
  const uri = (key) => (key in test.panels ? data.uris[test.panels[key]] : null);
  const put = (img, source) => {
    if (source) { if (img.getAttribute("src") !== source) img.src = source; } else img.removeAttribute("src");
    img.closest("figure").hidden = !source;
  };
  const svg = (name, attributes, parent) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    parent.appendChild(made);
    return made;
  };
  // from mm to the panel's own coordinates, 1000 for an inch
  const place = (frame) => {
    const [left, right, bottom, top] = frame.limits, [l, b, w, h] = frame.box, [W, H] = frame.size;
    return ([x, y]) => [
      Math.round(1000 * W * (l + w * (x - left) / (right - left))),
      Math.round(1000 * H * (1 - b - h * (y - bottom) / (top - bottom)))];
  };
  const path = (points, to) => "M" + points.map((p) => to(p).join(" ")).join("L") + "Z";
  const clear = (over, frame) => {
    over.replaceChildren();
    over.setAttribute("viewBox", `0 0 ${1000 * frame.size[0]} ${1000 * frame.size[1]}`);
  };

  function drawOver() {
    const mesh = test.meshes[state.model], region = state.region === null ? null : model().regions[state.region];
    for (const over of all("svg.over")) {
      if (!frame()) continue;
      clear(over, frame());
      if (!mesh) continue;
      const to = place(frame());
      const stroke = (layer, d) => svg("path", { d, fill: "none", stroke: data.colours[layer % data.colours.length], "stroke-width": 9 }, over);
      const shown = one("mesh").checked && over.closest("#viewer");
      if (mesh.lines) {
        for (const [layer, lines] of shown ? mesh.lines[shot()] || [] : []) {
          stroke(layer, lines.map((line) => "M" + line.map((p) => to(p).join(" ")).join("L")).join(""));
        }
        continue;
      }
      const nodes = mesh.moved[state.picture];
      const outline = (i) => path(mesh.rings[i].map((n) => nodes[n]), to);
      if (shown) mesh.names.forEach((_, layer) => stroke(layer, mesh.rings.map((_, i) => (mesh.layer[i] === layer ? outline(i) : "")).join("")));
      if (region && !over.closest("#viewer")) {
        svg("path", { d: region.elements.map(outline).join(""), fill: "#F0E442", "fill-opacity": 0.35, stroke: "#000", "stroke-width": 12 }, over);
      }
    }
    for (const over of all("svg.over-map")) {
      if (!map()) continue;
      clear(over, map());
      if (!region) continue;
      const to = place(map()), [sx, sy] = map().patch.map((s) => s / 2);
      for (const patch of region.patches) {
        const n = map().number ? map().number.indexOf(patch) : patch;
        if (n < 0) continue;
        const [x, y] = map().centre[n];
        svg("path", { d: path([[x - sx, y - sy], [x + sx, y - sy], [x + sx, y + sy], [x - sx, y + sy]], to), fill: "none", stroke: "#0072B2", "stroke-width": 28 }, over);
      }
    }
  }

  function draw() {
    const here = model(), count = here.pictures.length;
    state.picture = Math.max(0, Math.min(state.picture, count - 1));
    const shown = here.pictures[state.picture];
    for (const part of all("[data-for]")) part.hidden = part.dataset.for !== state.model || part.dataset.test !== test.test;
    for (const button of all("button[data-choose]")) button.setAttribute("aria-pressed", String(button.dataset.choose === test.test));
    for (const button of all("button[data-model]")) {
      button.classList.toggle("chosen", button.dataset.model === state.model);
      button.setAttribute("aria-pressed", String(button.dataset.model === state.model));
    }
    one("steps").hidden = count === 0;
    one("viewer").hidden = !Object.keys(test.panels).some((key) => key.startsWith(`measured|${state.model}|`));
    for (const id of ["slider", "slider-2"]) {
      const slider = one(id);
      if (slider) { slider.max = Math.max(0, count - 1); slider.value = state.picture; slider.disabled = count < 2; }
    }
    const name = shown ? `${shown.label} (${shown.seen})` : "";
    one("step-name").textContent = name;
    one("slider").setAttribute("aria-valuetext", name);
    for (const part of all(".now-step")) part.textContent = name;
    for (const part of all(".now-words")) {
      part.textContent = shown ? `difference ${shown.words}: ${shown.ratio} times the noise level` : "";
    }
    const views = test.views, group = views.length ? views[state.view].group : "";
    one("slices").hidden = views.length === 0 || count === 0;
    if (views.length) {
      const own = views.map((v, n) => n).filter((n) => views[n].group === group);
      one("slice").max = own.length - 1;
      one("slice").value = own.indexOf(state.view);
      one("slice").disabled = own.length < 2;
      one("slice").setAttribute("aria-valuetext", views[state.view].title);
      one("slice-name").textContent = views[state.view].title;
      for (const button of all("button[data-group]")) button.setAttribute("aria-pressed", String(button.dataset.group === group));
    }
    const effect = here.first_effect ? state.effect || here.first_effect : "";
    const kind = here.parts[effect] || "", curve = kind === "response";
    for (const part of all(".now-effect")) part.textContent = here.titles[effect] || effect;
    for (const part of all(".now-by")) part.textContent = here.pattern_by[effect] ? ` (${here.pattern_by[effect]})` : "";
    for (const part of all(".when-step")) part.hidden = curve;
    for (const img of all("img[data-panel]")) {
      let panel = img.dataset.panel;
      if (img.id === "blink-shot" && state.flipped) panel = "measured";
      const asked = panel === "pattern" || panel === "there";
      const key = `${panel}|${img.dataset.of || state.model}|${asked && curve ? "steps" : shot()}`;
      put(img, uri(asked ? `${key}|${panel === "pattern" || curve ? effect : kind}` : key));
    }
    one("blink-name").textContent = state.flipped ? "Measured" : "Synthesized";
    for (const row of all("tr[data-picture-step], tr[data-effect]")) {
      const inside = !row.closest("[data-for]").hidden;
      const own = "effect" in row.dataset ? row.dataset.effect === effect
        : "region" in row.dataset ? Number(row.dataset.region) === state.region
          : Number(row.dataset.pictureStep) === state.picture;
      row.classList.toggle("chosen", inside && own);
    }
    const mesh = test.meshes[state.model], legend = one("layers");
    one("mesh-choice").hidden = !mesh;
    legend.replaceChildren();
    if (mesh && one("mesh").checked) {
      mesh.names.forEach((layer, n) => {
        const item = document.createElement("span"), mark = document.createElement("i");
        mark.style.background = data.colours[n % data.colours.length];
        item.append(mark, layer);
        legend.append(item);
      });
    }
    drawOver();
  }

  function go(change) {
    if ("model" in change) { state.region = null; state.effect = null; }
    if ("picture" in change && !("region" in change)) state.region = null;
    Object.assign(state, change);
    draw();
  }

  function blink() {
    const stop = timer !== null;
    if (stop) { clearInterval(timer); timer = null; } else timer = setInterval(() => go({ flipped: !state.flipped }), 700);
    one("blink").setAttribute("aria-pressed", String(!stop));
    one("blink").textContent = stop ? "Blink measured ↔ synthesized" : "Stop blinking";
    go({ flipped: !stop });
  }

  for (const img of all("img[data-picture]")) img.src = data.uris[Number(img.dataset.picture)];
  for (const button of all("button[data-model]")) button.addEventListener("click", () => go({ model: button.dataset.model }));
  for (const button of all("button[data-choose]")) {
    button.addEventListener("click", () => {
      test = data.tests.find((own) => own.test === button.dataset.choose);
      go({ picture: model().pictures.length - 1, view: test.views.length ? middle(test.views[0].group) : 0, region: null });
    });
  }
  for (const id of ["slider", "slider-2"]) {
    const slider = one(id);
    if (slider) slider.addEventListener("input", () => go({ picture: Number(slider.value) }));
  }
  const members = (group) => test.views.map((v, n) => n).filter((n) => test.views[n].group === group);
  const middle = (group) => members(group)[Math.floor(members(group).length / 2)];
  for (const button of all("button[data-group]")) button.addEventListener("click", () => go({ view: middle(button.dataset.group) }));
  one("slice").addEventListener("input", () => go({ view: members(test.views[state.view].group)[Number(one("slice").value)] }));
  one("back").addEventListener("click", () => go({ picture: state.picture - 1 }));
  one("on").addEventListener("click", () => go({ picture: state.picture + 1 }));
  one("blink").addEventListener("click", blink);
  one("mesh").addEventListener("change", draw);
  for (const row of all("tr[data-picture-step]")) {
    row.addEventListener("click", () => {
      const change = { picture: Number(row.dataset.pictureStep) };
      if ("region" in row.dataset) change.region = Number(row.dataset.region);
      go(change);
      const show = row.closest("[data-for]").querySelector(".show") || one("viewer");
      show.scrollIntoView({ block: "start" });
    });
  }
  for (const row of all("tr[data-effect]")) {
    row.addEventListener("click", (event) => {
      if (event.target.closest("details")) return;
      go({ effect: row.dataset.effect });
      row.closest("[data-for]").querySelector(".patterns").scrollIntoView({ block: "start" });
    });
  }
  for (const button of all("button.all")) {
    button.addEventListener("click", () => {
      const open = button.closest("[data-for]").classList.toggle("open");
      button.setAttribute("aria-expanded", String(open));
      if (!("text" in button.dataset)) button.dataset.text = button.textContent;
      button.textContent = open ? "Show fewer rows" : button.dataset.text;
    });
  }
  state.picture = Math.max(0, model().pictures.length - 1);
  if (test.views.length) state.view = middle(test.views[0].group);
  draw();
})();
