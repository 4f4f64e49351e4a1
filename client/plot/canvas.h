// Private to plot/: a picture that is drawn at twice its size and scaled down at the end, for
// smooth lines and letters.

#ifndef MANEUVER_CLIENT_PLOT_CANVAS_H_
#define MANEUVER_CLIENT_PLOT_CANVAS_H_

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace maneuver::plot {

struct Color {
  int red = 0;
  int green = 0;
  int blue = 0;
};

// Colours for a light ground.
inline constexpr Color kPaper = {255, 255, 255};
inline constexpr Color kInk = {20, 20, 20};
inline constexpr Color kFaintInk = {90, 90, 90};

// Pixels of the finished picture, x to the right, y down.
using Pixel = cv::Point2d;
using Line = std::vector<Pixel>;

enum class Anchor { kLeft, kCenter, kRight };

struct Box {
  double left = 0.0;
  double top = 0.0;
  double width = 0.0;
  double height = 0.0;
  double right() const { return left + width; }
  double bottom() const { return top + height; }
  bool Holds(const Pixel& p) const {
    return p.x >= left && p.x <= right() && p.y >= top && p.y <= bottom();
  }
};

// Returns the colour of an action: the same in every picture, and bright enough for a dark ground.
Color ActionColor(int action_id);
// Colours of latent dimensions, for a light ground. Colour-blind people can distinguish them too.
inline constexpr int kLatentColors = 8;
Color LatentColor(int dimension);

class Canvas {
 public:
  Canvas(int width, int height, Color background);

  // Limits later drawing, except that of text, to the box.
  void ClipTo(const Box& box);
  void ClipToAll();

  // Draws lines of one colour as one layer: where they cross, the colour is applied once.
  //   opacity: in [0, 1].
  void Strokes(const std::vector<Line>& lines, Color color, double width, double opacity = 1.0);
  void Stroke(const Line& line, Color color, double width, double opacity = 1.0);
  void Dashes(const Line& line, Color color, double width, double dash, double gap);
  void Polygons(const std::vector<Line>& polygons, Color color, double opacity = 1.0);
  void Disc(const Pixel& center, double radius, Color color, double opacity = 1.0);
  void Rectangle(const Box& box, Color color, double opacity = 1.0);

  // Draws one line of text. Characters outside ASCII become '?', because the font has no others.
  //   baseline: position of the first, middle or last letter.
  //   height: height of a capital letter, pixels.
  void Text(const std::string& text, const Pixel& baseline, double height, Color color,
            Anchor anchor = Anchor::kLeft, bool bold = false);
  // Draws text turned a quarter counter-clockwise about its middle.
  void TextUpwards(const std::string& text, const Pixel& middle, double height, Color color);
  static double TextWidth(const std::string& text, double height, bool bold = false);
  // Returns the height of letters at which a text takes about `room` pixels at most: `height` or
  // less, but at least half of it.
  static double HeightToFit(const std::string& text, double height, double room);

  // Returns the finished picture.
  std::string EncodePng() const;

 private:
  cv::Mat picture_;  // supersampled, BGR
  cv::Rect clip_;    // supersampled
  cv::Mat layer_;    // scratch of the same size: coverage of the layer being drawn

  void Blend(const cv::Rect& area, Color color, double opacity);
};

}  // namespace maneuver::plot

#endif  // MANEUVER_CLIENT_PLOT_CANVAS_H_
