// What every screen gives to the frame around it.
export interface Screen {
  element: HTMLElement;
  /** Something of the session has changed, here or elsewhere. */
  refresh?: () => Promise<void>;
  undo?: () => void;
  redo?: () => void;
  /** The command line that does the same. */
  command: string;
  /** What brings the results up to date. */
  run?: { until: string; text: string };
  close?: () => void;
}
