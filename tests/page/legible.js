// Which texts of a page are hard to read.

/** In the page: texts below 12 pixels, or with less than WCAG's contrast AA of 4.5 against what is behind them. */
export function hardToRead() {
  const channels = (colour) => colour.match(/[\d.]+/g).map(Number);
  const luminance = (colour) => {
    const [r, g, b] = channels(colour).map((value) => (value <= 10.31 ? value / 3294.6 : ((value / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (element) => {
    const colour = getComputedStyle(element).backgroundColor;
    return channels(colour)[3] === 0 && element.parentElement ? behind(element.parentElement) : colour;
  };
  const says = (element) => [...element.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
  return [...document.querySelectorAll('body :not(svg *, :disabled, :disabled + *, option)')].flatMap((element) => {
    if (!element.checkVisibility() || !says(element)) return [];
    const style = getComputedStyle(element);
    const [light, dark] = [luminance(style.color), luminance(behind(element))].sort((a, b) => b - a);
    const contrast = (light + 0.05) / (dark + 0.05);
    return contrast < 4.5 || parseFloat(style.fontSize) < 12 ? [`${element.outerHTML}: ${contrast}, ${style.fontSize}`] : [];
  });
}
