/* A picture file that is dropped anywhere on the page, or chosen, goes to the server as it is. */
async function openPicture(file) {
  if (!file) return;
  try {
    const answer = await fetch(`dropped?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
    emitEvent(answer.ok ? "dropped" : "refused", await answer.text());
  } catch {
    emitEvent("refused", `${file.name}: cannot be read; must be a picture file`);
  }
}
const holdsFiles = (event) => event.dataTransfer.types.includes("Files");
addEventListener("dragover", (event) => holdsFiles(event) && event.preventDefault());
addEventListener("drop", (event) => {
  if (!holdsFiles(event)) return;
  event.preventDefault();
  openPicture(event.dataTransfer.files[0]);
});
