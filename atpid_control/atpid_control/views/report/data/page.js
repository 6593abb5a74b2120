(() => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const style = () => getComputedStyle(document.documentElement);
  const coloured = (part, css) => {
    if (typeof part === "string") return part.startsWith("@") ? css.getPropertyValue("--" + part.slice(1)).trim() : part;
    if (Array.isArray(part)) return typeof part[0] === "number" ? part : part.map((item) => coloured(item, css));
    if (part && typeof part === "object") return Object.fromEntries(Object.entries(part).map(([key, item]) => [key, coloured(item, css)]));
    return part;
  };
  const narrow = matchMedia("(max-width: 640px)");
  // no space beside the chart: the lines' labels go inside it, on the paper's colour
  const compact = (layout, paper) => {
    let stage = 0;
    const annotations = layout.annotations.map((note) => {
      if (note.name === "label") return { ...note, xanchor: "right", xshift: -2, bgcolor: paper, opacity: 0.85, borderpad: 1 };
      if (note.name !== "efficiency") return note;
      const end = layout.shapes[stage++].x1; // of the stage's shaded window
      return { ...note, x: end, xanchor: "right", font: { ...note.font, size: 12 } };
    });
    return { ...layout, margin: { ...layout.margin, l: 40, r: 10 }, annotations };
  };
  const draw = () => {
    const css = style();
    for (const [name, figure] of Object.entries(figures)) {
      const filled = coloured(figure, css);
      if (narrow.matches) filled.layout = compact(filled.layout, coloured("@paper", css));
      Plotly.react(name, filled.data, filled.layout, { responsive: true, displayModeBar: false });
    }
  };
  dark.addEventListener("change", draw);
  narrow.addEventListener("change", draw);
  draw();
})();
