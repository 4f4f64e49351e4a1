#include "tests/integration/all_methods.h"

#include "maneuver/v1/admin_service.pb.h"
#include "maneuver/v1/dataset_service.pb.h"
#include "maneuver/v1/model_service.pb.h"
#include "maneuver/v1/outcome_service.pb.h"
#include "maneuver/v1/prediction_service.pb.h"
#include "maneuver/v1/replica_service.pb.h"
#include "maneuver/v1/tag_service.pb.h"
#include "maneuver/v1/training_service.pb.h"

namespace maneuver::integration {

std::vector<const google::protobuf::MethodDescriptor*> AllMethods() {
  std::vector<const google::protobuf::MethodDescriptor*> methods;
  for (const auto* file :
       {v1::PredictRequest::descriptor()->file(), v1::ActionSet::descriptor()->file(),
        v1::UploadHeader::descriptor()->file(), v1::Job::descriptor()->file(),
        v1::Tags::descriptor()->file(), v1::GetLogLevelRequest::descriptor()->file(),
        v1::ReportOutcomesRequest::descriptor()->file(), v1::Replica::descriptor()->file()}) {
    for (int s = 0; s < file->service_count(); ++s) {
      for (int m = 0; m < file->service(s)->method_count(); ++m) {
        methods.push_back(file->service(s)->method(m));
      }
    }
  }
  return methods;
}

}  // namespace maneuver::integration
