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
  // no space beside the chart: units stand after the titles, the lines' labels below them
  const compact = (layout, names) => {
    const { range } = layout.xaxis;
    const side = (x) => {
      const share = (x - range[0]) / (range[1] - range[0]);
      return share > 0.7 ? "right" : share < 0.3 ? "left" : "center";
    };
    const begun = {}; // of each axis: where its next label begins [px]
    const annotations = layout.annotations.flatMap((note, place) => {
      if (note.name === "unit") return [];
      if (note.name === "mode") return [note];
      if (note.name === "title") return [{ ...note, text: `${note.text}, ${layout.annotations[place + 1].text}`, xshift: -40, yshift: note.yshift + 17 }];
      if (note.name === "efficiency") return [{ ...note, xanchor: side(note.x), font: { ...note.font, size: 12 } }];
      if (note.name === "printed") return [{ ...note, xanchor: side(note.x) }];
      const [x, top] = [begun[note.yref] || 0, layout["yaxis" + note.yref.slice(1)].domain[1]];
      begun[note.yref] = x + 9 * (note.text.length - 7) + 12; // without <b> and </b>
      return [{ ...note, yref: "paper", x: 0, xanchor: "left", xshift: x - 40, y: top, yanchor: "bottom", yshift: 3 }];
    });
    const below = 14 * names; // one below the other
    return { ...layout, height: layout.height + below, margin: { ...layout.margin, l: 46, r: 10, t: 52, b: layout.margin.b + below }, annotations };
  };
  const draw = () => {
    const css = style();
    for (const [name, figure] of Object.entries(figures)) {
      const filled = coloured(figure, css);
      if (narrow.matches) filled.layout = compact(filled.layout, filled.data.filter((line) => line.showlegend).length);
      Plotly.react(name, filled.data, filled.layout, { responsive: true, displayModeBar: false });
    }
  };
  dark.addEventListener("change", draw);
  narrow.addEventListener("change", draw);
  draw();
})();
