// What NiceGUI has no part for: a loupe over both pictures, and copying where the page is not served by HTTPS.
const explorerCopy = text => {
  const area = document.createElement("textarea");
  area.value = text;
  document.body.append(area);
  area.select();
  document.execCommand("copy");
  area.remove();
};

addEventListener("pointermove", event => {
  const pane = event.target.closest?.(".pane > div");
  document.body.classList.toggle("magnified", Boolean(pane));
  if (!pane) return;
  const box = pane.getBoundingClientRect();
  const x = (event.clientX - box.left) / box.width, y = (event.clientY - box.top) / box.height;
  for (const image of document.querySelectorAll(".pane > div > img:first-child")) {
    if (!image.clientWidth) continue;
    const loupe = image.closest(".pane").querySelector(".loupe");
    const zoom = Math.max(2, 5 * image.naturalWidth / image.clientWidth);
    const at = [x * image.clientWidth, y * image.clientHeight];
    loupe.style.left = `${at[0]}px`;
    loupe.style.top = `${at[1]}px`;
    loupe.style.backgroundImage = `url("${image.currentSrc}")`;
    loupe.style.backgroundSize = `${image.clientWidth * zoom}px ${image.clientHeight * zoom}px`;
    loupe.style.backgroundPosition = at.map(each => `${loupe.clientWidth / 2 - each * zoom}px`).join(" ");
  }
});
addEventListener("pointerup", event => event.pointerType !== "mouse" && document.body.classList.remove("magnified"));
