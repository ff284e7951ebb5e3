"use strict";
(() => {
  const byId = (name) => document.getElementById(name);
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
  const viewer = byId("viewer");
  const MOST_ZOOM = 32, CLOSE = 3, KEY_STEP = 2, PAGE_STEP = 10, ZOOM_STEP = 1.5;

  // -- which pictures --------------------------------------------------------------------------
  const camera = () => (byId("camera") ? byId("camera").value : "0");
  const sheet = (name) =>
    document.querySelector(`.contact figure[data-name="${name}"][data-camera="${camera()}"]`);

  function show() {
    const kind = document.querySelector("input[name=map]:checked").value;
    for (const side of ["left", "right"]) {
      const figure = sheet(byId(side).value);
      const picture = figure.querySelector(".picture");
      const map = figure.querySelector("." + kind);
      byId(side + "-picture").src = picture.src;
      byId(side + "-picture").alt = picture.alt;
      byId(side + "-map").src = map.src;
      const words = figure.querySelector("figcaption").innerText.replace(/\s*\n\s*/g, ", ");
      byId(side + "-map").alt = (kind === "error" ? "Error map of " : "Signed difference of ") + words;
      byId(side + "-tag").textContent = byId(side).selectedOptions[0].textContent;
      byId(side + "-caption").textContent = (side === "left" ? "Left: " : "Right: ") + words;
      viewer.style.setProperty("--aspect", picture.naturalWidth / picture.naturalHeight || 1);
    }
    byId("error-scale").hidden = kind !== "error";
    byId("difference-scale").hidden = kind !== "difference";
  }

  // -- divider ---------------------------------------------------------------------------------
  const divider = byId("divider"), split = byId("split"), leftLayer = byId("left-layer");
  let share = 50;
  function divide(percent) {
    share = clamp(percent, 0, 100);
    leftLayer.style.clipPath = `inset(0 ${100 - share}% 0 0)`;
    divider.style.left = `${share}%`;
    divider.setAttribute("aria-valuenow", Math.round(share));
    divider.setAttribute("aria-valuetext", `${Math.round(share)} % left`);
  }
  const percentAt = (event) => {
    const box = split.getBoundingClientRect();
    return (100 * (event.clientX - box.left)) / box.width;
  };
  divider.addEventListener("keydown", (event) => {
    const moves = { ArrowLeft: -KEY_STEP, ArrowDown: -KEY_STEP, ArrowRight: KEY_STEP, ArrowUp: KEY_STEP,
      PageDown: -PAGE_STEP, PageUp: PAGE_STEP, Home: -100, End: 100 };
    if (!(event.key in moves)) return;
    event.preventDefault();
    event.stopPropagation();
    divide(share + moves[event.key]);
  });

  // -- zoom and pan, the same in all panes -------------------------------------------------------
  const panes = [...viewer.querySelectorAll(".pane")];
  const view = { zoom: 1, x: 0, y: 0 }; // corner of what is seen, in shares of the picture
  function place() {
    view.zoom = clamp(view.zoom, 1, MOST_ZOOM);
    view.x = clamp(view.x, 0, 1 - 1 / view.zoom);
    view.y = clamp(view.y, 0, 1 - 1 / view.zoom);
    for (const pane of panes) {
      pane.classList.toggle("zoomed", view.zoom > 1);
      pane.classList.toggle("close", view.zoom >= CLOSE);
      for (const image of pane.querySelectorAll("img"))
        image.style.transform =
          `translate(${-100 * view.x * view.zoom}%, ${-100 * view.y * view.zoom}%) scale(${view.zoom})`;
    }
  }
  function zoomAt(factor, u = 0.5, v = 0.5) { // u, v: the place in the pane that stays
    const before = view.zoom;
    view.zoom = clamp(before * factor, 1, MOST_ZOOM);
    view.x += u / before - u / view.zoom;
    view.y += v / before - v / view.zoom;
    place();
  }
  function pan(du, dv) { // in shares of the pane
    view.x -= du / view.zoom;
    view.y -= dv / view.zoom;
    place();
  }
  function within(pane, event) {
    const box = pane.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }
  byId("closer").addEventListener("click", () => zoomAt(ZOOM_STEP));
  byId("further").addEventListener("click", () => zoomAt(1 / ZOOM_STEP));
  byId("whole").addEventListener("click", () => zoomAt(1 / MOST_ZOOM));
  split.addEventListener("keydown", (event) => {
    const pans = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
    if (event.key === "+" || event.key === "=") zoomAt(ZOOM_STEP);
    else if (event.key === "-") zoomAt(1 / ZOOM_STEP);
    else if (event.key === "0") zoomAt(1 / MOST_ZOOM);
    else if (event.key in pans && view.zoom > 1) pan(...pans[event.key]);
    else return;
    event.preventDefault();
  });

  for (const pane of panes) {
    const pointers = new Map();
    let dividing = false;
    pane.addEventListener("pointerdown", (event) => {
      pointers.set(event.pointerId, event);
      const grip = divider.contains(event.target);
      dividing = grip || (pane === split && view.zoom === 1 && pointers.size === 1);
      if (grip) divider.focus({ preventScroll: true });
      pane.setPointerCapture(event.pointerId);
      if (pane === split && !grip && event.pointerType === "mouse") split.focus({ preventScroll: true });
      if (event.pointerType === "mouse") event.preventDefault();
    });
    pane.addEventListener("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) return;
      const box = pane.getBoundingClientRect();
      if (pointers.size === 2) {
        const other = [...pointers.values()].find((one) => one.pointerId !== event.pointerId);
        const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY) || 1;
        const [u, v] = within(pane, other);
        zoomAt(apart(event) / apart(last), u, v);
      } else if (dividing) divide(percentAt(event));
      else pan((event.clientX - last.clientX) / box.width, (event.clientY - last.clientY) / box.height);
      pointers.set(event.pointerId, event);
    });
    const forget = (event) => pointers.delete(event.pointerId);
    pane.addEventListener("pointerup", forget);
    pane.addEventListener("pointercancel", forget);
    pane.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !pane.contains(document.activeElement) && view.zoom === 1) return;
      event.preventDefault();
      zoomAt(Math.exp(-event.deltaY / 300), ...within(pane, event));
    }, { passive: false });
  }

  // -- values of the marks in the plots ----------------------------------------------------------
  const tip = byId("tip");
  function tell(point) {
    tip.textContent = point.dataset.tip;
    tip.hidden = false;
    const mark = point.getBoundingClientRect(), box = tip.getBoundingClientRect();
    const above = mark.top - box.height - 8;
    tip.style.left = `${clamp(mark.left + mark.width / 2 - box.width / 2, 8, innerWidth - box.width - 8)}px`;
    tip.style.top = `${above > 8 ? above : mark.bottom + 8}px`;
  }
  for (const point of document.querySelectorAll(".point")) {
    const title = point.querySelector("title");
    if (title) title.remove(); // one hint is enough; the label says it to screen readers
    point.addEventListener("pointerenter", () => tell(point));
    point.addEventListener("focus", () => tell(point));
    for (const leaving of ["pointerleave", "blur"])
      point.addEventListener(leaving, () => { tip.hidden = true; });
  }
  addEventListener("scroll", () => { tip.hidden = true; }, { passive: true });

  for (const name of ["left", "right", "camera"])
    if (byId(name)) byId(name).addEventListener("change", show);
  for (const choice of document.querySelectorAll("input[name=map]")) choice.addEventListener("change", show);
  viewer.hidden = false;
  show();
  divide(50);
  place();
  const first = sheet("reference").querySelector(".picture");
  if (!first.complete) first.addEventListener("load", show);
})();
