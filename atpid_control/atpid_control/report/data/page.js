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
  const draw = () => {
    const css = style();
    for (const [name, figure] of Object.entries(figures)) {
      const filled = coloured(figure, css);
      Plotly.react(name, filled.data, filled.layout, { responsive: true, displayModeBar: false });
    }
  };
  dark.addEventListener("change", draw);
  draw();
})();
