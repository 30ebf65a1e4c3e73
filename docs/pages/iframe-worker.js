// Search where the guide is opened from the disk: browsers start no worker from a file there. This one runs the
// worker's script in a frame of its own, whose messages are the worker's.
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.waiting = []
      const own = new URL(url, location)
      const frame = document.createElement("iframe")
      frame.hidden = true
      document.documentElement.append(frame)
      const inside = frame.contentWindow
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }))
      inside.importScripts = (...urls) => urls.reduce((done, each) => done.then(() => load(each)), Promise.resolve())
      const load = (source) => new Promise((loaded, failed) => {
        const script = inside.document.createElement("script")
        script.src = new URL(source, own)
        script.onload = loaded
        script.onerror = failed
        inside.document.body.append(script)
      })
      load(own).then(() => {
        this.inside = inside
        this.waiting.splice(0).forEach((data) => this.postMessage(data))
      })
    }
    postMessage(data) {
      if (this.inside) this.inside.dispatchEvent(new MessageEvent("message", { data }))
      else this.waiting.push(data)
    }
    terminate() {}
  }
}
