// What every screen gives to the frame around it.
export interface Screen {
  element: HTMLElement;
  /** Something of the session has changed, here or elsewhere. */
  refresh?: () => Promise<void>;
  undo?: () => void;
  redo?: () => void;
  /** The command line that does the same; a text node where it changes with what is shown. */
  command: string | Text;
  /** What brings the results up to date. */
  run?: { until: string; text: string } | { ask: () => object; text: string };
  close?: () => void;
}
